"""Barostats as flows of splitting words.

Imports `stepping` and `baths`. The stepper of splittings uses them.
"""
