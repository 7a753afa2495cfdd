"""Charges: Ewald's sum to a stated accuracy, by waves or on a mesh, and Coulomb's law in open space or with a cutoff.

Imports `pairs`, `lists` and `laws`. Users meet it as `kd.Coulomb`.
"""
