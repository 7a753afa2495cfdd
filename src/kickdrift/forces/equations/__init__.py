"""Right-hand sides of Problems, as forces.

Imports `seam`.
"""
