"""Fields and springs that ship.

Imports `laws` and `bonded`.
"""
