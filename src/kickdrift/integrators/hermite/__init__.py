"""Hermite's method of order 4, with shared steps and with block steps.

Imports `stepping`.
"""
