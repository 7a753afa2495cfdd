"""Data files of LAMMPS with changed numbers, lines and letters, as the particles of a system file and by themselves."""

import random

from kickdrift_validation.fuzzing.case import Case, dice
from kickdrift_validation.fuzzing.system_files import NUMBER, cut, letters, line, number, replaced

KIND = "lammps-data"
ATOMS = """LAMMPS data file of four atoms

4 atoms
2 atom types
0.0 6.0 xlo xhi
0.0 6.0 ylo yhi
0.0 6.0 zlo zhi

Masses

1 1.0
2 2.0

Atoms # atomic

1 1 1.0 1.0 1.0
2 1 3.0 1.0 1.0
3 2 1.0 3.0 1.0
4 2 3.0 3.0 3.0

Velocities

1 0.1 0.0 0.0
2 -0.1 0.0 0.0
3 0.0 0.1 0.0
4 0.0 0.0 -0.1
"""
CHAIN = """LAMMPS data file of a chain

3 atoms
1 atom types
2 bonds
1 bond types
1 angles
1 angle types
0.0 8.0 xlo xhi
0.0 8.0 ylo yhi
0.0 8.0 zlo zhi
0.5 0.0 0.0 xy xz yz

Masses

1 1.0  # A

Atoms # molecular

1 1 1 1.0 1.0 1.0
2 1 1 2.0 1.0 1.0
3 1 1 3.0 1.0 1.0

Bonds

1 1 1 2
2 1 2 3

Angles

1 1 1 2 3
"""
SYSTEM = """units = "{units}"
particles = {{ file = "x{suffix}" }}
force = [{{ type = "lennard-jones", epsilon = 1.0, sigma = 1.0, cutoff = 2.5, truncation = "shift" }}]
run = {{ integrator = "velocity-verlet", dt = 0.001 }}
"""


def section(rng: random.Random, text: str) -> str:
    """A heading that is another, or none."""
    names = ("Masses", "Atoms # atomic", "Atoms # molecular", "Atoms # full", "Velocities", "Bonds", "Angles", "Pairs")
    found = [name for name in names if f"\n{name}\n" in text]
    return text.replace(f"\n{rng.choice(found)}\n", f"\n{rng.choice(('', 'x', *names))}\n") if found else text


def count(rng: random.Random, text: str) -> str:
    """A number of the first lines that is another."""
    head, sep, rest = text.partition("xlo")
    wild = ("0", "-1", "3", "5", "1000000000000", "nan", "1e300", "99999999999999999999")
    return replaced(rng, head, NUMBER, lambda match: rng.choice(wild)) + sep + rest


MUTATIONS = {number: 6, line: 4, letters: 2, cut: 1, section: 3, count: 3}


def case(number: int, seed: int = 0) -> Case:
    rng = dice(KIND, seed, number)
    text, about = rng.choice((ATOMS, CHAIN)), []
    for mutate in rng.choices(list(MUTATIONS), list(MUTATIONS.values()), k=rng.choice((0, 1, 1, 1, 2, 3))):
        text = mutate(rng, text)
        about.append(mutate.__name__)
    suffix = rng.choice((".data", ".lmp", ".lammps-data"))
    system = SYSTEM.format(units=rng.choice(("lj", "lj", "metal")), suffix=suffix)
    files = {f"x{suffix}": text.encode("utf-8", "surrogatepass"), "s.toml": system.encode()}
    ways = (("run", "s.toml", "--steps", "2", "--quiet"), ("info", "s.toml"), ("info", f"x{suffix}"))
    return Case(KIND, number, (rng.choice(ways),), f"{suffix}: {', '.join(about)}", files, may_compute=True)
