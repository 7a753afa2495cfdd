"""Chaos: MEGNO, Lyapunov exponents and spectra.

Imports `tangents`. Ensembles and the command line use it.
"""
