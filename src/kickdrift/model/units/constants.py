"""Physical constants in SI units.

CODATA 2022 (Mohr, Newell, Taylor & Tiesinga 2025, Rev. Mod. Phys. 97, 025002, doi:10.1103/RevModPhys.97.025002); all
but the last three are exact. `scipy.constants` has the values of another year in each SciPy version, and takes a tenth
of a second to import.
"""

BOLTZMANN = 1.380649e-23  # J/K
ELEMENTARY_CHARGE = 1.602176634e-19  # C
LIGHT = 299792458.0  # m/s
AVOGADRO = 6.02214076e23  # 1/mol
AU = 149597870700.0  # m, IAU 2012
DAY = 86400.0  # s
ATOMIC_MASS = 1.66053906892e-27  # kg
GRAVITY = 6.6743e-11  # m^3/(kg s^2)
VACUUM_PERMITTIVITY = 8.8541878188e-12  # F/m
