"""Leapfrog on whole numbers, which goes back to the same bits.

Imports `stepping`.
"""
