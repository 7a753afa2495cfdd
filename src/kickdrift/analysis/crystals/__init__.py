"""Crystals: elastic constants, from stress under finite strain, and what files of potentials hold.

Imports no other analysis.
"""
