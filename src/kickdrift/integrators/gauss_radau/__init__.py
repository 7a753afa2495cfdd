"""Gauss-Radau of order 15, with steps chosen by the error.

Imports `stepping`. `trace` uses its step in encounters.
"""
