"""Run files that are damaged, forged, or lead out of the file: one to three of `OPERATIONS` on a whole one."""

import json
import os
import random
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from kickdrift_validation.fuzzing.case import NUMBERS, TEXTS, Case, dice
from kickdrift_validation.fuzzing.places import WHOLE

RECORDS = (
    "kickdrift/system/record", "kickdrift/method", "kickdrift/versions", "kickdrift/system/source", "kickdrift/report",
)  # fmt: skip
DTYPES = ("i1", "i8", "u8", "f2", "f4", "f8", ">f8", "c16", "b1", "S8", "V7")
Operation = Callable[[random.Random, h5py.File], str]


def links(file: h5py.File) -> list[str]:
    """The names of everything in the file."""
    found: list[str] = []
    file.visit_links(lambda name: found.append(name))
    return found


def datasets(file: h5py.File) -> list[str]:
    return [name for name in links(file) if file.get(name, getclass=True) is h5py.Dataset]


def groups(file: h5py.File) -> list[str]:
    return ["/", *(name for name in links(file) if file.get(name, getclass=True) is h5py.Group)]


def put(file: h5py.File, name: str, data: Any, **options: Any) -> None:
    """A dataset in the place of whatever has the name."""
    if name in file:
        del file[name]
    file.create_dataset(name, data=data, **options)


def lose(rng: random.Random, file: h5py.File) -> str:
    name = rng.choice(links(file))
    del file[name]
    return f"lose {name}"


def rename(rng: random.Random, file: h5py.File) -> str:
    name, other = rng.sample(links(file), 2)
    del file[other]
    file.move(name, other)
    return f"{name} in the place of {other}"


def group_for_dataset(rng: random.Random, file: h5py.File) -> str:
    name = rng.choice(datasets(file))
    del file[name]
    file.create_group(name)
    return f"group for {name}"


def dataset_for_group(rng: random.Random, file: h5py.File) -> str:
    name = rng.choice(groups(file)[1:])
    del file[name]
    file[name] = rng.choice((1.0, "text", [1, 2, 3]))
    return f"dataset for {name}"


def dtype(rng: random.Random, file: h5py.File) -> str:
    name, kind = rng.choice(datasets(file)), rng.choice(DTYPES)
    shape, chunks = file[name].shape, file[name].chunks
    put(file, name, np.zeros(shape, kind), chunks=chunks, maxshape=file[name].maxshape if chunks else None)
    return f"{name} as {kind}"


def odd_dtype(rng: random.Random, file: h5py.File) -> str:
    name = rng.choice(datasets(file))
    rows = (file[name].shape or (1,))[:1]
    kinds = {
        "text": h5py.string_dtype(), "lists": h5py.vlen_dtype("f8"), "references": h5py.ref_dtype,
        "regions": h5py.regionref_dtype, "compound": np.dtype([("a", "f8"), ("b", "S3")]),
        "enumeration": h5py.enum_dtype({"A": 0, "\x1b[31m": 1}), "arrays": np.dtype(("f8", (2, 2))),
    }  # fmt: skip
    kind = rng.choice(list(kinds))
    del file[name]
    file.create_dataset(name, shape=rows, dtype=kinds[kind])
    return f"{name} of {kind}"


def shape(rng: random.Random, file: h5py.File) -> str:
    name = rng.choice(datasets(file))
    old = file[name].shape or ()
    kind = file[name].dtype if h5py.check_string_dtype(file[name].dtype) is None else np.dtype("f8")
    new = rng.choice(((), (0,), (1,), (3,), (*old, 2), old[1:], (2, *old), tuple(max(0, n - 1) for n in old), old[:1]))
    put(file, name, np.zeros(new, kind))
    return f"{name} of shape {new}"


def null(rng: random.Random, file: h5py.File) -> str:
    name = rng.choice(datasets(file))
    kind = file[name].dtype
    del file[name]
    file[name] = h5py.Empty(kind)
    return f"{name} without a space"


def huge(rng: random.Random, file: h5py.File) -> str:
    """Rows that are declared and not there."""
    name = rng.choice([each for each in datasets(file) if file[each].chunks])
    rows = rng.choice((2**20, 2**31, 2**40, 2**60))
    file[name].resize(rows, axis=0)
    return f"{rows} rows of {name}"


def fewer(rng: random.Random, file: h5py.File) -> str:
    name = rng.choice([each for each in datasets(file) if file[each].chunks])
    rows = rng.randrange(file[name].shape[0] + 1)
    file[name].resize(rows, axis=0)
    return f"{rows} rows of {name}"


def numbers(rng: random.Random, file: h5py.File) -> str:
    """A number of a dataset that is none of the frames' replaced."""
    known = [each for each in datasets(file) if file[each].dtype.kind in "iuf" and file[each].size
             and not each.endswith(("position/value", "velocity/value"))]  # fmt: skip
    name = rng.choice(known)
    values = file[name][()]
    limits = np.iinfo(values.dtype) if values.dtype.kind in "iu" else np.finfo(values.dtype)
    kinds: list[Any] = [0, 1, limits.min, limits.max]
    if values.dtype.kind == "f":
        kinds += [np.nan, np.inf, -np.inf, -1.0]
    else:
        kinds += [limits.max // 2, limits.max - 1]
    flat = values.reshape(-1)
    flat[rng.randrange(flat.size)] = rng.choice(kinds)
    file[name][...] = flat.reshape(values.shape)
    return f"a number of {name}"


def attribute(rng: random.Random, file: h5py.File) -> str:
    owners = [name for name in links(file) if file.get(name) is not None and len(file[name].attrs)]
    owner = file[rng.choice(owners)]
    key = rng.choice(list(owner.attrs))
    del owner.attrs[key]
    if rng.random() < 0.8:
        owner.attrs[key] = rng.choice(
            (0, -1, 99, 2**63 - 1, 1.5, np.nan, "", "\x1b[31mx", "x" * 30_000, [1, 2, 3], ["a", "b"], h5py.Empty("f8"),
             b"\xff\xfe", np.zeros((2, 2)), True)
        )  # fmt: skip
    return f"attribute {key} of {owner.name}"


def unknown(rng: random.Random, file: h5py.File) -> str:
    """What the format's page promises that readers pass over."""
    place = rng.choice(
        ("/", "kickdrift", "kickdrift/samples", "observables", "particles", "particles/trajectory", "h5md")
    )
    if rng.random() < 0.5:
        file.create_group(f"{place}/of_the_future/inside")
    else:
        file[f"{place}/of_the_future"] = rng.choice((1.0, "text", np.arange(5.0), np.zeros((2, 2))))
    return f"unknown thing in {place}"


def fixed(rng: random.Random, file: h5py.File) -> str:
    """The same numbers in a dataset that does not grow."""
    name = rng.choice([each for each in datasets(file) if file[each].chunks])
    values = file[name][()]
    attributes = dict(file[name].attrs)
    put(file, name, values)
    file[name].attrs.update(attributes)
    return f"{name} of a fixed size"


def record(rng: random.Random, file: h5py.File) -> str:
    """A JSON record that is of another type, without end, or no JSON."""
    name = rng.choice(RECORDS)
    texts = ("null", "[]", "{}", "1", '"x"', "true", "[1, 2]", "", "{", "NaN", '{"a": NaN}', "[" * 100_000,
    '{"a":' * 5000,
             '{"forces": {}}', "1" + "0" * 5000, '{"\\u001b[31m": "\\u001b]0;x\\u0007"}', '["\\ud800"]')  # fmt: skip
    return _write_text(file, name, rng.choice(texts))


def leaf(rng: random.Random, file: h5py.File) -> str:
    """A value inside a JSON record, or a key."""
    name = rng.choice(RECORDS[:3])
    data = json.loads(file[name].asstr()[()])
    place, where = data, name
    while True:
        keys = list(place) if isinstance(place, dict) else list(range(len(place)))
        if not keys:
            break
        key = rng.choice(keys)
        where += f".{key}"
        if isinstance(place[key], (dict, list)) and place[key] and rng.random() < 0.8:
            place = place[key]
            continue
        others = (
            None, [], {}, True, -1, 0, 1e308, 2**70, 1.5, "x", [[1]], {"a": 1}, float("nan"), *TEXTS, *NUMBERS[:14],
        )  # fmt: skip
        if isinstance(place, dict) and rng.random() < 0.15:
            place[str(rng.choice(TEXTS))] = place.pop(key)
        elif rng.random() < 0.15:
            del place[key]
        else:
            place[key] = rng.choice(others)
        break
    _write_text(file, name, json.dumps(data))
    if rng.random() < 0.7:
        _sign(file)
    return where


def callable_name(rng: random.Random, file: h5py.File) -> str:
    """A force, method, measure or event that is a callable of another module."""
    data = json.loads(file[RECORDS[0]].asstr()[()])
    module, name, parameters = rng.choice((
        ("os", "system", {"command": "touch ../outside/called"}),
        ("subprocess", "Popen", {"args": ["touch", "../outside/called"]}),
        ("builtins", "eval", {"source": "1"}), ("builtins", "open", {"file": "../outside/called", "mode": "w"}),
        ("pathlib", "Path", {}), ("shutil", "rmtree", {"path": "../outside"}),
        ("os", "remove", {"path": "../outside/secret.txt"}),
        ("kickdrift.run.simulation", "Simulation", {}),
        ("kickdrift.trajectory.write.h5md", "Writer", {"path": "../outside/called"}),
        ("kickdrift.systemfile.reading", "load", {"name_or_path": "../outside/secret.txt"}),
        ("os", "_exit", {"status": 0}),
        ("kickdrift.forces", "FORCES", {}), ("numpy", "load", {"file": "../outside/secret.bin"}), ("sys", "exit", {}),
    ))  # fmt: skip
    entry = {"type": name, "module": module, "parameters": parameters}
    data["forces"] = [entry] if rng.random() < 0.7 else [*data["forces"], entry]
    if rng.random() < 0.3:
        data["events"] = [{"kind": name, **entry}]
    _write_text(file, RECORDS[0], json.dumps(data))
    _sign(file)
    return f"force {module}.{name}"


def way_out(rng: random.Random, file: h5py.File) -> str:
    """A link, storage or virtual dataset that leads out of the file, or in a circle."""
    what = rng.choice(("external link", "soft link", "storage", "virtual", "circle", "dangling", "itself", "reference"))
    name = rng.choice(groups(file)[1:] if what == "circle" else links(file))
    del file[name]
    target = rng.choice(("/numbers", "/text", "/", "/step", "/grows", "/no-such-thing"))
    if what == "external link":
        file[name] = h5py.ExternalLink(
            rng.choice(("../outside/secret.h5", "no-such-file.h5", "../outside/secret.txt")), target
        )
    elif what == "soft link":
        file[name] = h5py.SoftLink(rng.choice(("/particles", "/kickdrift/committed", "/h5md", "../../x")))
    elif what == "storage":
        file.create_dataset(name, (11, 3, 3), "f8", external=[("../outside/secret.bin", 0, h5py.h5f.UNLIMITED)])
    elif what == "virtual":
        layout = h5py.VirtualLayout((11, 3, 3), "f8")
        layout[:] = h5py.VirtualSource("../outside/secret.h5", "/numbers", (11, 3, 3))
        file.create_virtual_dataset(name, layout)
    elif what == "circle":
        file[name] = file["/"]
    elif what == "dangling":
        file[name] = h5py.SoftLink("/nowhere")
    elif what == "itself":
        file[name] = h5py.SoftLink(f"/{name}")
    else:
        file.create_dataset(name, data=file.ref, dtype=h5py.ref_dtype)
    return f"{what} for {name}"


def filtered(rng: random.Random, file: h5py.File) -> str:
    """A dataset in other chunks, with filters."""
    name = rng.choice([each for each in datasets(file) if file[each].chunks])
    values, attributes = file[name][()], dict(file[name].attrs)
    options: dict[str, Any] = rng.choice(
        ({"compression": "gzip"}, {"fletcher32": True}, {"shuffle": True}, {"scaleoffset": 0})
    )
    if "scaleoffset" in options and values.dtype.kind != "i":
        options = {"compression": "lzf"}
    put(file, name, values, maxshape=(None, *values.shape[1:]), chunks=True, **options)
    file[name].attrs.update(attributes)
    return f"{name} with {options}"


def _write_text(file: h5py.File, name: str, text: str) -> str:
    if name == "kickdrift/report":
        data = np.frombuffer(text.encode("utf-8", "surrogatepass"), "u1")
        file[name].resize((len(data),))
        file[name][...] = data
    else:
        put(file, name, text, dtype=h5py.string_dtype())
    return f"{name} is {text[:30]}"


def _sign(file: h5py.File) -> None:
    """Give the file the hashes of what it says now, as whoever forges one would."""
    from kickdrift.trajectory.layout import names as layout

    for group, name in (("kickdrift/system", "system_hash"), ("kickdrift", "run_hash")):
        if hasattr(layout, name):
            with suppress(Exception):
                file[group].attrs["sha256"] = getattr(layout, name)(file)


OPERATIONS: dict[Operation, int] = {
    lose: 4, rename: 3, group_for_dataset: 2, dataset_for_group: 2, dtype: 4, odd_dtype: 4, shape: 4, null: 2, huge: 3,
    fewer: 3, numbers: 5, attribute: 4, unknown: 2, fixed: 2, record: 4, leaf: 5, callable_name: 4, way_out: 6,
    filtered: 2,
}  # fmt: skip


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
