"""Observables of particles: structure, motion and pressure, from files or arrays.

Imports no other analysis. `certify` reads its input in the same way.
"""
