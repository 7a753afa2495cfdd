"""Crystals: elastic constants, from stress under finite strain.

Imports no other analysis.
"""
