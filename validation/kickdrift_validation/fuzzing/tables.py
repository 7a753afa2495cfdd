"""Tables of ensembles and their journals, damaged: what is read is right, or one line says what is wrong."""

import random

from kickdrift_validation.fuzzing.case import Case, dice
from kickdrift_validation.fuzzing.places import MEMBERS
from kickdrift_validation.fuzzing.run_files import base

KIND = "tables"


def flipped(rng: random.Random, data: bytes) -> tuple[bytes, str]:
    """The bytes with one kind of damage."""
    found = bytearray(data)
    places = [place for place in rng.choices(range(len(found)), k=40) if found[place]] or [0]
    what = rng.choices(("bit", "bits", "byte", "zeros", "noise", "cut", "short", "longer"), (10, 3, 4, 2, 2, 2, 1, 1))[
        0
    ]
    if what in ("bit", "bits"):
        for place in places[: 1 if what == "bit" else 12]:
            found[place] ^= 1 << rng.randrange(8)
    elif what == "byte":
        found[places[0]] = rng.choice((0, 1, 0x7F, 0x80, 0xFF))
    elif what in ("zeros", "noise"):
        size = min(rng.choice((8, 64, 512, 4096)), len(found) - places[0])
        found[places[0] : places[0] + size] = bytes(size) if what == "zeros" else rng.randbytes(size)
    elif what == "cut":
        del found[rng.randrange(len(found)) :]
    elif what == "short":
        del found[places[0] : places[0] + rng.choice((1, 8, 512))]
    else:
        found += rng.randbytes(rng.choice((1, 100, 10_000)))
    return bytes(found), what


def case(number: int, seed: int = 0) -> Case:
    rng = dice(KIND, seed, number)
    name = rng.choice(MEMBERS)
    data, what = flipped(rng, base(name))
    read = ("!table", name)
    ways = rng.choice((
        (read,), (read,), (read,), (("info", name),), (("plot", name, "--output", "x.png"),),
        (("plot", name, "--column", "dt", "--output", "x.png"),),
    ))  # fmt: skip
    return Case(KIND, number, ways, f"{name}: {what}", {name: data})
