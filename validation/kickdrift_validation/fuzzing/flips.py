"""Run files with flipped bits, overwritten or lost bytes: what is read is right, or one line says what is wrong."""

import io
import random
from functools import cache

import h5py

from kickdrift_validation.fuzzing.case import Case, dice
from kickdrift_validation.fuzzing.places import WHOLE
from kickdrift_validation.fuzzing.run_files import NAME, base, commands, datasets

KIND = "flipped-bytes"
FRAMES = tuple(f"particles/trajectory/{name}" for name in ("position/value", "velocity/value", "position/step"))


@cache
def extents(name: str, frames: bool = False) -> list[tuple[int, int]]:
    """Where the chunks and arrays of a file lie, or those of the frames alone: offset and size in bytes."""
    found = []
    with h5py.File(io.BytesIO(base(f"{name}.h5md")), "r") as file:
        for each in FRAMES if frames else datasets(file):
            data = file[each]
            if data.chunks:
                infos = [data.id.get_chunk_info(k) for k in range(data.id.get_num_chunks())]
                found += [(info.byte_offset, info.size) for info in infos]
            elif data.id.get_offset() is not None:
                found.append((data.id.get_offset(), data.id.get_storage_size()))
    return sorted(set(found))


def used(data: bytes, rng: random.Random, name: str) -> int:
    """A place in the file: in a frame or an array, in what HDF5 keeps of them, or anywhere."""
    for _ in range(50):
        where = rng.random()
        if where < 0.6:
            offset, size = rng.choice(extents(name, frames=where < 0.4))
            place = offset + rng.randrange(min(size, 1600))
        elif where < 0.8:
            place = rng.randrange(min(len(data), 6000))
        else:
            place = rng.randrange(len(data))
        if data[place]:
            break
    return place


def flipped(rng: random.Random, data: bytes, name: str) -> tuple[bytes, str]:
    """The bytes with one kind of damage."""
    found = bytearray(data)
    what = rng.choices(("bit", "bits", "byte", "zeros", "noise", "cut", "short", "longer"), (8, 3, 4, 2, 2, 2, 1, 1))[0]
    if what in ("bit", "bits"):
        for _ in range(1 if what == "bit" else rng.randint(2, 20)):
            found[used(data, rng, name)] ^= 1 << rng.randrange(8)
    elif what == "byte":
        found[used(data, rng, name)] = rng.choice((0, 1, 0x7F, 0x80, 0xFF))
    elif what in ("zeros", "noise"):
        place, size = used(data, rng, name), rng.choice((8, 64, 512, 4096))
        size = min(size, len(data) - place)
        found[place : place + size] = bytes(size) if what == "zeros" else rng.randbytes(size)
    elif what == "cut":
        del found[rng.randrange(len(found)) :]
    elif what == "short":
        place = rng.randrange(len(found))
        del found[place : place + rng.choice((1, 8, 512))]
    else:
        found += rng.randbytes(rng.choice((1, 100, 10_000)))
    return bytes(found), what


def case(number: int, seed: int = 0) -> Case:
    rng = dice(KIND, seed, number)
    name = rng.choice(list(WHOLE))
    data, what = flipped(rng, base(f"{name}.h5md"), name)
    # Half of the cases read: nothing else compares what there is with what was written.
    read = ("!read", NAME, WHOLE[name], f"{name}.h5md")
    if rng.random() < 0.5:
        ways: tuple[tuple[str, ...], ...] = (read,)
    elif rng.random() < 0.4:
        ways = (("resume", NAME, "--quiet"), read)
    else:
        ways = commands(rng, name)
    return Case(KIND, number, ways, f"{name}: {what}", {NAME: data}, may_change=frozenset({NAME}))
