"""A file is data: nothing that it names is called, and one line says what was refused."""

from __future__ import annotations

import json
import os
import pickle
import struct
import subprocess
import sys
import types

import h5py
import numpy as np
import pytest

import kickdrift as kd
from kickdrift.cli import main as cli
from kickdrift.errors import InputError
from kickdrift.forces.seam import named
from kickdrift.integrators.own.registration import load_file
from kickdrift.trajectory.layout.names import run_hash, system_hash
from kickdrift.trajectory.write.h5md import Writer
from tests.long import shortened

CANARY = "the-canary"
FORCES = {  # module and name that no file may give
    "a shell": ("os", "system"),
    "another shell": ("posix", "system"),
    "a process": ("subprocess", "Popen"),
    "Python": ("builtins", "eval"),
    "an import": ("builtins", "__import__"),
    "a class of NumPy": ("numpy", "memmap"),
    "a function of kickdrift": ("kickdrift.systemfile.reading", "load"),
    "the command line": ("kickdrift.cli.main", "main"),
    "a bound force, which holds an address": ("kickdrift.forces.equations.equation", "EquationKernel"),
    "the base of forces": ("kickdrift.forces.pairs.law", "PairForce"),
    "an event": ("kickdrift.model.events.events", "Crossing"),
    "a method of a force": ("kickdrift.forces.gravity.direct", "Gravity.bind"),
    "an imported class": ("somebodys_module", "Bomb"),
    "an imported class of a force": ("somebodys_module", "Trap"),
    "no module": ("no_such_module", "Trap"),
    "a path": ("../../somebodys_module", "Trap"),
    "a name with a newline": ("os\n\x1b[31m", "system"),
}
EVENTS = {
    "a shell": {"type": "system", "module": "os", "parameters": {"command": CANARY}},
    "a class of events' module": {"type": "Between", "parameters": {"quantity": "x", "body": 0, "about": 1}},
    "a function by name": {"type": "Crossing", "parameters": {"function": "os.system", "name": "n"}},
    "an unknown quantity": {
        "type": "Crossing",
        "parameters": {"function": {"quantity": "__class__", "body": 0, "about": 1}, "name": "n"},
    },
    "an unknown parameter": {"type": "Escape", "parameters": {"distance": 1.0, "canary": CANARY}},
    "a text for a number": {"type": "Escape", "parameters": {"distance": "far"}},
    "a table for a body": {"type": "CloseApproach", "parameters": {"distance": 1.0, "bodies": [{"a": 1}]}},
}
METHODS = {
    "integrator": "os.system",
    "engine": "../lammps_worker",
    "options": {"dt": 0.1, "canary": CANARY},
    "threads": "many",
    "processes": -1,
}
RUNS = {"dt": [1.0], "rtol": {"a": 1}, "integrator": 5}


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    path = tmp_path_factory.mktemp("whole") / "run.h5md"
    kd.Simulation(kd.load("two-body"), "velocity-verlet", dt=0.01).run(4, every=1, output=path)
    return path


def changed(path, whole, change, where="system/record"):
    """A copy of a run's file with other JSON and the right hash: an attacker can write such a file."""
    path.write_bytes(whole.read_bytes())
    with h5py.File(path, "r+") as file:
        record = json.loads(file["kickdrift"][where].asstr()[()])
        change(record)
        del file["kickdrift"][where]
        file["kickdrift"][where] = json.dumps(record)
        file["kickdrift/system"].attrs["sha256"] = system_hash(file)
        file["kickdrift"].attrs["sha256"] = run_hash(file)
    return path


@pytest.fixture
def called(monkeypatch):
    """Names in a hostile file that were called with the canary."""
    calls = []
    module = types.ModuleType("somebodys_module")

    class Bomb:
        def __init__(self, **parameters):
            calls.append("Bomb")

    class Trap(kd.HarmonicTrap):
        def __post_init__(self):
            calls.append("Trap")

    module.Bomb, module.Trap = Bomb, Trap
    Trap.__module__, Trap.__qualname__ = module.__name__, "Trap"
    monkeypatch.setitem(sys.modules, module.__name__, module)
    for name, attribute in FORCES.values():
        original = getattr(sys.modules.get(name), attribute, None)
        if name in ("os", "posix", "subprocess", "kickdrift.systemfile.reading", "kickdrift.cli.main"):

            def canary(*given, original=original, **more):
                if CANARY in [*given, *more.values()]:
                    calls.append(original)
                    return None
                return original(*given, **more)

            if not isinstance(original, type):
                monkeypatch.setattr(sys.modules[name], attribute, canary)
    return calls


def commanded(monkeypatch, capfd, *words):
    """Exit status, standard output and standard error of a command."""
    monkeypatch.setattr(sys, "argv", ["kickdrift", *map(str, words)])
    with pytest.raises(SystemExit) as ended:
        MAIN()
    return ended.value.code, *capfd.readouterr()


MAIN = cli.main


@pytest.mark.parametrize("kind", shortened(FORCES, [*FORCES][::3]))
def test_a_file_names_no_callable(tmp_path, whole, called, monkeypatch, capfd, kind):
    module, name = FORCES[kind]

    def hostile(record):
        record["forces"] = [{"type": name, "module": module, "parameters": {"command": CANARY, "stiffness": 1.0}}]

    path = changed(tmp_path / "bad.h5md", whole, hostile)
    before = path.read_bytes()
    with kd.open(path) as run:  # the run is data and can be read
        assert len(run) == 5
        for ask in (run.system, lambda: run[1].system, lambda: kd.resume(path), lambda: kd.resume(path, step=1)):
            with pytest.raises(
                InputError, match=r"belongs to module .*, which is not loaded or does not register this force"
            ):
                ask()
    status, out, said = commanded(monkeypatch, capfd, "resume", path)
    assert (status, out, said.count("\n")) == (2, "", 1)
    assert said.startswith(f"kickdrift: {path}: force ")
    assert "\x1b" not in said
    status, out, said = commanded(monkeypatch, capfd, "info", path)
    assert (status, said) == (0, "")
    assert "is registered nowhere" in out
    assert "\x1b" not in out
    assert commanded(monkeypatch, capfd, "export", path, tmp_path / "out.xyz")[0] == 0
    assert called == []
    assert path.read_bytes() == before


def test_a_figure_calls_nothing(tmp_path, whole, called, monkeypatch, capfd):
    def hostile(record):
        record["forces"] = [
            {"type": name, "module": module, "parameters": {"G": None, "command": CANARY}}
            for module, name in FORCES.values()
        ]

    path = changed(tmp_path / "bad.h5md", whole, hostile)
    assert commanded(monkeypatch, capfd, "plot", path)[0] == 0
    assert called == []


@pytest.mark.parametrize("kind", EVENTS)
def test_events_of_a_file(tmp_path, whole, called, kind):
    path = changed(tmp_path / "bad.h5md", whole, lambda record: record.update(events=[{"kind": "k", **EVENTS[kind]}]))
    with pytest.raises(InputError) as caught:
        kd.resume(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)
    assert called == []


@pytest.mark.parametrize("key", METHODS)
def test_methods_of_a_file(tmp_path, whole, called, key):
    path = changed(tmp_path / "bad.h5md", whole, lambda method: method.update({key: METHODS[key]}), "method")
    with pytest.raises(InputError, match=f"{path}: .*{'option canary' if key == 'options' else key}"):
        kd.resume(path)
    assert called == []


@pytest.mark.parametrize("key", RUNS)
def test_defaults_of_a_file(tmp_path, whole, key):
    path = changed(tmp_path / "bad.h5md", whole, lambda record: record["run"].update({key: RUNS[key]}))
    with pytest.raises(InputError, match=rf"{path}: damaged: kickdrift/system/record: run\.{key}: "):
        kd.resume(path)


def test_units_of_a_file_are_no_sums(tmp_path, whole):
    path = tmp_path / "bad.h5md"
    for text in ("9**9**9**9 m", "9^9^9", "(m*m)**9999", "m" * 10**6):
        path.write_bytes(whole.read_bytes())
        with h5py.File(path, "r+") as file:
            file["kickdrift/units"].attrs["length"] = text[:50_000]
        with pytest.raises(InputError, match=f"{path}: damaged: kickdrift/units: length: .* is not a unit"):
            kd.open(path)


GRAVITY = {"type": "Gravity", "module": "kickdrift.forces.gravity.direct"}
PARAMETERS = {
    "an unknown one": ({"canary": CANARY}, "force Gravity.canary: unknown key"),
    "a text": ({"softening": "os.system"}, "force Gravity.softening: "),
    "a table": ({"G": {"a": 1}}, "force Gravity.G: "),
    "a truth": ({"G": True}, "force Gravity.G: "),
    "infinity": ({"softening": float("inf")}, "force Gravity.softening: "),
}


@pytest.mark.parametrize("kind", PARAMETERS)
def test_parameters_are_checked(tmp_path, whole, kind):
    parameters, said = PARAMETERS[kind]
    force = {**GRAVITY, "parameters": parameters}
    path = changed(tmp_path / "bad.h5md", whole, lambda record: record.update(forces=[force]))
    with pytest.raises(InputError) as caught:
        kd.resume(path)
    assert str(caught.value).startswith(f"{path}: {said}")
    assert "\n" not in str(caught.value)


def test_a_key_of_a_newer_version_is_passed_over(tmp_path, whole):
    def newer(record):
        record["new"] = record["run"]["new"] = record["forces"][0]["new"] = 1

    with kd.open(changed(tmp_path / "new.h5md", whole, newer)) as run:
        assert run.system().forces == kd.load("two-body").forces


LAW = """
from typing import NamedTuple
import kickdrift as kd

@kd.pair_law
class Mine(NamedTuple):
    k: float = 1.0
    def law(p, r2):
        return p.k * (4.0 - r2) ** 2, 4.0 * p.k * (4.0 - r2)

class Outer:
    @kd.pair_law
    class Inner(NamedTuple):
        k: float = 1.0
        def law(p, r2):
            return p.k * (4.0 - r2) ** 2, 4.0 * p.k * (4.0 - r2)

class Trap(kd.HarmonicTrap):
    pass
"""


def test_a_law_of_a_loaded_file(tmp_path, monkeypatch):
    monkeypatch.setattr(named, "REGISTERED", {})
    (tmp_path / "loaded_law.py").write_text(LAW)
    load_file(tmp_path / "loaded_law.py")
    module = sys.modules["loaded_law"]
    for name, force in {
        "Mine": module.Mine(cutoff=2.0, species={"A": {"k": 2.0}}, pairs={("A", "A"): {"k": 3.0}}),
        "Inner": module.Outer.Inner(cutoff=2.0),
        "Trap": module.Trap(1.0),
    }.items():
        with Writer(tmp_path / f"{name}.h5md", kd.System(np.eye(3), forces=[force]), method={}, every=1):
            pass
        with kd.open(tmp_path / f"{name}.h5md") as run:
            if name != "Trap":
                assert run.system().forces == (force,)
            for table in ({}, {("loaded_law", "Mine"): kd.LennardJones} if name != "Mine" else {}):
                with monkeypatch.context() as patch:  # a class of a loaded module is not found in that module
                    patch.setattr(named, "REGISTERED", table)
                    with pytest.raises(
                        InputError, match=f"force {name} belongs to module loaded_law, which is not loaded"
                    ):
                        run.system()
    monkeypatch.delitem(sys.modules, "loaded_law")


def short(array):
    return array[..., :-1].copy()


def liquid(**how):
    return kd.Simulation(kd.load("lj-1000"), dt=0.004, **how)


CHECKPOINTS = {
    "fewer coordinates": lambda c: c["stepper"].update(y=short(c["stepper"]["y"])),
    "a cursor that is short": lambda c: c["stepper"].update(cursor=short(c["stepper"]["cursor"])),
    "a cursor behind the start": lambda c: c["stepper"]["cursor"].__setitem__(2, -(10**9)),
    "a cursor of texts": lambda c: c["stepper"].update(cursor=np.full(5, "x")),
    "a list of a few positions": lambda c: c["stepper"]["forces"][0].update(pruned_at=np.zeros(3)),
    "a list made at fewer": lambda c: c["stepper"]["forces"][0].update(built_at=np.zeros((3, 1))),
    "no end of room": lambda c: c["stepper"]["forces"][0].update(room=10**12),
    "room that is none": lambda c: c["stepper"]["forces"][0].update(room=-5),
    "a skin that is no number": lambda c: c["stepper"]["forces"][0].update(outer_skin=float("nan")),
    "a skin without end": lambda c: c["stepper"]["forces"][0].update(outer_skin=1e300),
    "a step before the start": lambda c: c["stepper"].update(steps_done=-1),
    "no list": lambda c: c["stepper"].update(forces=[]),
    "a missing part": lambda c: c["stepper"].pop("cursor"),
    "texts": lambda c: c["stepper"].update(y="texts"),
    "a record of texts": lambda c: c["record"].update(steps="many"),
    "an event that is none": lambda c: c["record"].update(events=[{"kind": "k"}]),
    "a record of another kind": lambda c: c["record"].update(canary=CANARY),
}


def test_checkpoints_that_do_not_fit():
    sim = liquid()
    sim.run(3)
    good = sim.checkpoint()
    for what, change in CHECKPOINTS.items():
        bad = pickle.loads(pickle.dumps(good))
        change(bad)
        with pytest.raises(InputError, match=r"^checkpoint: ") as caught:
            liquid().restore(bad)
        assert "\n" not in str(caught.value), what
    again = liquid()
    again.restore(good)
    sim.run(3)
    again.run(3)
    assert again.state.phase.tobytes() == sim.state.phase.tobytes()


def robertson(t, y):
    return [-0.04 * y[0] + 1e4 * y[1] * y[2], 0.04 * y[0] - 1e4 * y[1] * y[2] - 3e7 * y[1] ** 2, 3e7 * y[1] ** 2]


@pytest.mark.parametrize("method", ["bdf", "lsoda"])
def test_checkpoints_of_solvers(method):
    def made():
        return kd.Simulation(kd.Problem(robertson, [1.0, 0.0, 0.0], compiled=False), method)

    sim = made()
    sim.run(12)  # BDF then has factors of its matrix
    good = sim.checkpoint()
    solver = good["stepper"]["solver"]
    changes = [lambda s: s.update({"fun.__func__": 1, "t": "now"}), lambda s: s.pop("t")]
    if method == "bdf":
        changes = [*changes, lambda s: s["LU"].__setitem__(1, np.array([10**6] * 3, np.int32))]
    else:
        key = "_lsoda_solver._integrator."
        changes += [
            lambda s: s[key + "state_ints"].__setitem__(3, 10**6),  # first index of its table
            lambda s: s[key + "state_ints"].__setitem__(34, 10**6),  # its order
            lambda s: s[key + "iwork"].__setitem__(20, 10**6),  # a row
            lambda s: s.update({key + "rwork": np.zeros(3)}),
        ]
    assert solver["t"] > 0
    for change in changes:
        bad = pickle.loads(pickle.dumps(good))
        change(bad["stepper"]["solver"])
        with pytest.raises(InputError, match=r"^checkpoint: "):
            made().restore(bad)
    again = made()
    again.restore(good)
    assert again.run(until=1.0).steps == sim.run(until=1.0).steps
    assert again.state.y.tobytes() == sim.state.y.tobytes()


# --- ensembles ---


class Shell:
    """A pickle that runs a command."""

    def __init__(self, command):
        self.command = command

    def __reduce__(self):
        return os.system, (self.command,)


def ensemble():
    return kd.Ensemble("two-body", {"dt": [0.01, 0.02]}, integrator="leapfrog", steps=2)


@pytest.mark.parametrize(
    "lines",
    [
        [[1, 2]],
        [{"identity": 5}],
        [{}, "row"],
        [{}, {"member": "0", "status": "done"}],
        [{}, {"member": -1, "status": "done"}],
        [{}, {"member": 0, "status": ["done"]}],
        [{}, {"status": "done"}],
    ],
)
def test_a_hostile_journal(tmp_path, lines):
    own, path = ensemble(), tmp_path / "table.parquet"
    if isinstance(lines[0], dict) and not lines[0]:
        lines = [own.provenance(), *lines[1:]]
    journal = path.with_name("table.parquet.journal")
    journal.write_text("".join(json.dumps(line) + "\n" for line in lines))
    with pytest.raises(InputError, match=r"table\.parquet.* (is no journal|holds an ensemble)") as caught:
        own.run(output=path)
    assert "\n" not in str(caught.value)
    assert journal.exists()


def test_a_table_holds_no_pickles(tmp_path, monkeypatch, capfd):
    pyarrow, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    mark = tmp_path / "called"
    for made in (Shell(f"touch {mark}"),):
        cargo = pickle.dumps(made)
        extension = {"ARROW:extension:name": "arrow.py_extension_type", "ARROW:extension:metadata": cargo}
        field = pyarrow.field("member", pyarrow.int64(), metadata=extension)
        schema = pyarrow.schema([field], metadata={"PANDAS_ATTRS": json.dumps({"kickdrift": {}}), "pandas": b"\x80"})
        table = pyarrow.Table.from_arrays([pyarrow.array([0])], schema=schema)
        parquet.write_table(table, tmp_path / "table.parquet")
        with h5py.File(tmp_path / "table.h5", "w") as file:
            file.attrs["columns"], file.attrs["kickdrift"] = ["member"], "{}"
            file["table/member"] = np.void(cargo)
        with h5py.File(tmp_path / "object.h5", "w") as file:
            file.attrs["columns"], file.attrs["kickdrift"] = ["member"], "{}"
            kind = h5py.h5t.create(h5py.h5t.OPAQUE, 8)
            kind.set_tag(b"NUMPY:|O")
            space = h5py.h5s.create_simple((1,))
            h5py.h5d.create(file.create_group("table").id, b"member", kind, space)
    for name in ("table.parquet", "table.h5", "object.h5"):
        status, _, said = commanded(monkeypatch, capfd, "info", tmp_path / name)
        assert (status, said.count("\n")) == (2, 1), said
        with pytest.raises(InputError):
            ensemble().run(output=tmp_path / name)
    assert not mark.exists()


def test_processes_of_an_engine_import_nothing_from_the_folder(tmp_path, monkeypatch):
    from kickdrift.engines import lammps_processes

    words = {}

    def begun(command, **how):
        words.update(safe=how["env"]["PYTHONSAFEPATH"], path=how["env"]["PYTHONPATH"])
        raise OSError("enough")

    monkeypatch.setattr(lammps_processes, "mpiexec", lambda: "mpiexec")
    monkeypatch.setattr(subprocess, "Popen", begun)
    monkeypatch.delenv("PYTHONPATH", raising=False)
    with pytest.raises(OSError, match="enough"):
        lammps_processes.Processes(2)
    assert words["safe"] == "1"  # the current folder may be another user's
    assert "" not in words["path"].split(os.pathsep)


# --- laws that keep state ---

COUNT = [0]
TABLE = np.zeros(3)
rng = np.random.default_rng(1)


def helper(r2):
    COUNT.append(r2)
    return r2


def counted(p, r2):
    global CALLS
    CALLS = r2
    return r2, r2


def closed():
    calls = 0

    def law(p, r2):
        nonlocal calls
        calls += 1
        return r2 + calls, r2

    return law


def array_default(p, r2, seen=np.zeros(1)):  # noqa: B008
    seen[0] += 1
    return r2 + seen[0], r2


def list_default(p, r2, *, seen=[]):  # noqa: B006
    return r2, r2


def table(p, r2):
    TABLE[0] += 1
    return r2 + TABLE[0], r2


def helped(p, r2):
    return helper(r2), r2


def drawn(p, r2):
    return r2 + np.random.random(), r2  # noqa: NPY002


def generated(p, r2):
    return r2 + rng.random(), r2


STATES = {
    counted: "it sets CALLS, which belongs to other code",
    closed(): "it sets calls, which belongs to other code",
    array_default: "the default of seen is a ndarray",
    list_default: "the default of seen is a list",
    table: "it changes TABLE",
    helped: r"it changes COUNT \(in helper\)",
    drawn: r"it uses np\.random",
    generated: "it uses rng",
}


@pytest.mark.parametrize("law", STATES, ids=lambda law: law.__name__)
def test_a_law_that_keeps_state_is_refused(law):
    from typing import NamedTuple

    class Law(NamedTuple):
        k: float = 1.0

    Law.law = law
    with pytest.raises(InputError, match=f"^Law: law keeps state between calls: {STATES[law]}; a pair's energy and"):
        kd.pair_law(Law)


def test_a_law_of_constants_is_none(monkeypatch):
    from typing import NamedTuple

    weights = [1.0, 2.0]

    @kd.pair_law
    class Law(NamedTuple):
        k: float = 1.0

        def law(p, r2, half=0.5):
            r = weights[0] * TABLE[1] + float(np.sqrt(r2))
            return half * p.k * r, -half * p.k / float(np.sqrt(r2))

    assert Law(cutoff=1.0).law.law(4.0) == (1.0, -0.25)


def test_a_list_of_unknown_kind_is_refused_before_hdf5_reads_it(tmp_path):
    """HDF5 crashes on a type of variable length that is neither a list nor a text."""
    path = tmp_path / "run.h5md"
    with h5py.File(path, "w", libver="earliest") as file:
        file.create_dataset("table/x", (1,), h5py.string_dtype())[0] = "text"
        raw = file["table/x"].id.get_type().encode()[2:6]
    data = bytearray(path.read_bytes())
    place = data.find(raw)
    assert place > 0
    data[place + 1] ^= 4
    path.write_bytes(data)
    with pytest.raises(InputError, match="its type is damaged"):
        kd.open(path)


NAMES = b"HEAP\0\0\0\0"


@pytest.mark.parametrize(
    ("part", "claimed", "message"),
    [
        ("header", 2**31, "its header claims 2,147,483,648 bytes"),
        ("names", 2**40, "its heap of names claims"),
        ("free place", 128, "its heap of names is damaged"),
        ("root", 2**31, "its header claims 2,147,483,648 bytes"),
    ],
)
def test_claims_of_a_damaged_structure_are_refused_before_hdf5_allocates_them(tmp_path, part, claimed, message):
    path = tmp_path / "run.h5md"
    with h5py.File(path, "w", libver="earliest") as file:
        file["table/x"] = 1.0
        table, root = (h5py.h5o.get_info(file[name].id).addr for name in ("table", "/"))
    data = bytearray(path.read_bytes())
    heap = data.find(NAMES, table)  # the second heap is that of the group
    _, free, names = struct.unpack_from("<QQQ", data, heap + 8)
    form, place = {
        "header": ("<I", table + 8), "root": ("<I", root + 8), "names": ("<Q", heap + 8),
        "free place": ("<Q", names + free + 8),
    }[part]  # fmt: skip
    struct.pack_into(form, data, place, claimed)
    path.write_bytes(data)
    with pytest.raises(InputError, match=message):
        kd.open(path)


def test_structures_of_later_versions_are_checked_too(tmp_path):
    path = tmp_path / "run.h5md"
    with h5py.File(path, "w", libver="latest") as file:
        file["table/x"] = 1.0
        table = h5py.h5o.get_info(file["table"].id).addr
    data = bytearray(path.read_bytes())
    assert data[table : table + 4] == b"OHDR"
    data[table + 5] |= 2  # four bytes of size
    path.write_bytes(data)
    with pytest.raises(InputError, match="its header claims"):
        kd.open(path)
