"""Physical constants in SI units, and the symbols of the chemical elements.

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

SYMBOLS = (  # noqa: SIM905 - by atomic number; none has the number 0
    "- H He Li Be B C N O F Ne Na Mg Al Si P S Cl Ar K Ca Sc Ti V Cr Mn Fe Co Ni Cu Zn Ga Ge As Se Br Kr Rb Sr Y Zr Nb "
    "Mo Tc Ru Rh Pd Ag Cd In Sn Sb Te I Xe Cs Ba La Ce Pr Nd Pm Sm Eu Gd Tb Dy Ho Er Tm Yb Lu Hf Ta W Re Os Ir Pt Au "
    "Hg Tl Pb Bi Po At Rn Fr Ra Ac Th Pa U Np Pu Am Cm Bk Cf Es Fm Md No Lr Rf Db Sg Bh Hs Mt Ds Rg Cn Nh Fl Mc Lv Ts "
    "Og"
).split()
