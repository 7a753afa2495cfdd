"""Samples of a run: energies, momenta and other observables, computed in compiled code or in Python."""
