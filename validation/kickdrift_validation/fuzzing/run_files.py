"""Run files that are damaged, forged, or lead out of the file: one to three of `operations` on a whole one."""

import os
import random
from collections.abc import Sequence
from functools import cache
from pathlib import Path

import h5py

from kickdrift_validation.fuzzing.case import Case, dice
from kickdrift_validation.fuzzing.operations import OPERATIONS, Operation, callable_name, way_out
from kickdrift_validation.fuzzing.places import WHOLE

KIND = "run-files"
NAME = "run.h5md"


@cache
def base(name: str) -> bytes:
    """The bytes of a file that was not damaged."""
    return (Path(os.environ["KICKDRIFT_FUZZ_BASE"]) / name).read_bytes()


def damaged(rng: random.Random, data: bytes, operations: Sequence[Operation]) -> tuple[bytes, list[str]]:
    """The file after these operations, and what they did; one that cannot be done is left out."""
    about = list[str]()
    with h5py.File(h5py.h5f.open_file_image(data, h5py.h5f.ACC_RDWR)) as file:
        for operation in operations:
            try:
                about.append(operation(rng, file))
            except Exception as error:
                about.append(f"({operation.__name__}: {type(error).__name__})")
        file.flush()
        return bytes(file.id.get_file_image()), about


def commands(rng: random.Random, name: str) -> tuple[tuple[str, ...], ...]:
    """What is done with a damaged file."""
    read = ("!read", NAME, WHOLE[name], f"{name}.h5md")
    suffix = rng.choice(("xyz", "xyz", "extxyz", "dcd", "xtc", "pdb", "traj"))
    return rng.choice((
        (("info", NAME),), (("info", NAME),), (read,), (read,),
        (("resume", NAME, "--quiet"),), (("resume", NAME, "--quiet"), read),
        (("resume", NAME, "--steps", "60", "--quiet"),), (("export", NAME, f"x.{suffix}", "--quiet"),),
        (("plot", NAME),),
    ))  # fmt: skip


def case(number: int, seed: int = 0) -> Case:
    rng = dice(KIND, seed, number)
    name = rng.choice(list(WHOLE))
    operations = rng.choices(list(OPERATIONS), list(OPERATIONS.values()), k=rng.choice((1, 1, 1, 2, 3)))
    ways = commands(rng, name)
    if rng.random() < 0.2:  # alone, so that nothing else is in its way
        operations = [rng.choice((callable_name, way_out))]
        ways = rng.choice((ways, (("resume", NAME, "--quiet"),), (("resume", NAME, "--steps", "60", "--quiet"),)))
    data, about = damaged(rng, base(f"{name}.h5md"), operations)
    # What was done on purpose may look right, so that only flipped bytes are held against the truth.
    ways = tuple(("!open", each[1]) if each[0] == "!read" else each for each in ways)
    return Case(KIND, number, ways, f"{name}: {'; '.join(about)}", {NAME: data}, may_change=frozenset({NAME}))
