"""Forces that Python computes: functions, and calculators of ASE.

Imports `seam` and `fields`.
"""
