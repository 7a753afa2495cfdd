"""Archives of rebound with changed, lost or foreign bytes: what is read is finite, or one line says what is wrong.

An archive has no checksums, so that a flipped digit may be read as another number.
"""

import random
import struct
import tempfile
from functools import cache
from pathlib import Path

from kickdrift_validation.fuzzing.case import Case, dice

KIND = "archives"
NAME = "a.bin"
METHODS = ("whfast", "ias15", "leapfrog", "trace", "saba")
WORDS = (0, 1, 2, 255, 2**31 - 1, 2**31, 2**32 - 1, 2**63 - 1, 2**63, 2**64 - 1)


@cache
def bases() -> dict[str, bytes]:
    """Archives of three snapshots, by rebound's method."""
    import rebound

    found = {}
    for method in METHODS:
        sim = rebound.Simulation()
        sim.units = ("AU", "yr", "Msun")
        sim.add(m=1.0, r=0.005, name="Sun")
        sim.add(m=1e-3, a=1.1, e=0.1, inc=0.1, name="b")
        sim.add(m=3e-4, a=2.3, e=0.2, omega=1.0)
        sim.add(a=3.5, e=0.01)
        sim.N_active, sim.integrator, sim.dt = 3, method, 0.01
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / NAME
            for _ in range(3):
                sim.save_to_file(str(path))
                sim.steps(20)
            found[method] = path.read_bytes()
    return found


def changed(rng: random.Random, data: bytearray) -> str:
    """Change some bytes; what was done."""
    what = rng.choice(("byte", "byte", "bit", "word", "word", "noise", "zeros", "cut", "short", "twice", "name"))
    place = rng.randrange(64, len(data))
    if what == "byte":
        data[place] = rng.choice((0, 1, 127, 128, 255, rng.randrange(256)))
    elif what == "bit":
        data[place] ^= 1 << rng.randrange(8)
    elif what == "word":
        data[place : place + 8] = struct.pack("<Q", rng.choice(WORDS))
    elif what in ("noise", "zeros"):
        size = min(rng.choice((4, 16, 64, 512)), len(data) - place)
        data[place : place + size] = rng.randbytes(size) if what == "noise" else bytes(size)
    elif what == "cut":
        del data[place:]
    elif what == "short":
        del data[place : place + rng.choice((1, 8, 100))]
    elif what == "twice":
        data[place:place] = data[place : place + rng.choice((1, 8, 100, 2000))]
    else:  # a letter of a field's name becomes another byte
        letters = [k for k in range(64, len(data) - 1) if data[k : k + 2].isalpha()]
        data[rng.choice(letters)] = rng.choice(b"\0a_\xff\x1b")
    return f"{what} at {place}"


def case(number: int, seed: int = 0) -> Case:
    rng = dice(KIND, seed, number)
    method = rng.choice(METHODS)
    data, about = bytearray(bases()[method]), [method]
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        about.append(changed(rng, data))
    ways = (("info", NAME), ("run", NAME, "--steps", "2", "--quiet"), ("run", NAME, "--time", "0.01", "--quiet"))
    return Case(KIND, number, (rng.choice(ways),), ", ".join(about), {NAME: bytes(data)}, may_compute=True)
