"""Minimisation: the nearest positions of least potential energy.

Imports the integration under way. The Simulation and the command line use it.
"""
