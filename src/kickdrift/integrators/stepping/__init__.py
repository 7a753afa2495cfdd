"""Steppers, the compiled loops of fixed and of chosen steps, and many small systems in lanes.

Imports `options` and `flows`; no family of methods. All families use it.
"""
