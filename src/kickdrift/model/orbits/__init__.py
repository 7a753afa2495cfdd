"""Osculating orbits of bodies about a central one.

Imports `starts`. Systems, bridges, figures and views use it.
"""
