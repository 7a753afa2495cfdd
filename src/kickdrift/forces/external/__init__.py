"""Forces from Python: functions, calculators of ASE, and pair styles of LAMMPS.

Imports `seam` and `fields`.
"""
