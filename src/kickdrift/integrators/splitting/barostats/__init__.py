"""Barostats as flows of splitting words.

Imports `stepping`, `baths` and `constraints`. The stepper of splittings uses them.
"""
