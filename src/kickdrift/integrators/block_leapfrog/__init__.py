"""Leapfrog with block steps over the gravity tree: each body has a step of its own, and only those that end are summed.

Imports `stepping`.
"""
