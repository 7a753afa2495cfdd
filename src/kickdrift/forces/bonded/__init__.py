"""Bonds, angles, dihedrals and impropers, and the laws that users write for them.

Imports `laws`. Springs among `fields` use its kernel.
"""
