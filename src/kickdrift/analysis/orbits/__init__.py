"""Orbits of a run over time: elements, proper frequencies, resonances.

Imports no other analysis.
"""
