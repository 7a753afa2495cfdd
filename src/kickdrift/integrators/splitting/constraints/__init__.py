"""Constraints as flows of splitting words.

Imports `stepping`. The stepper of splittings uses them.
"""
