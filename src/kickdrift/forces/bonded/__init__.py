"""Bonds, angles, dihedrals, impropers, CMAP and listed pairs, and the laws that users write for them.

Imports `laws`. Springs among `fields` list their own pairs, as `ListedPairs` does, and use its kernel.
"""
