"""Work of every member of an ensemble, in a form that can be sent to other processes, and its identity."""

from __future__ import annotations

import hashlib
import inspect
import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from importlib.metadata import version
from pathlib import Path
from threading import Lock
from tokenize import TokenError
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np

from kickdrift.disk.outputs import reason
from kickdrift.ensemble.members import Member, path_of, with_values
from kickdrift.errors import InputError
from kickdrift.forces.seam.named import home_of, load_module
from kickdrift.integrators import INTEGRATORS
from kickdrift.integrators.asked import draws_noise, from_text
from kickdrift.integrators.method import Method
from kickdrift.integrators.own.registration import load_file
from kickdrift.model.problem import Problem
from kickdrift.model.run_defaults import RunDefaults
from kickdrift.model.system import System
from kickdrift.systemfile.reading import built, draws

Measure = Callable[..., Any]
RUN, MEGNO = "run", "megno"
INTEGRATOR = ("run", "integrator")  # path of the key
VERSION = version("kickdrift")
_LOADING = Lock()  # a worker may have threads
_LOADED: set[Path] = set()  # files of integrators, in this process


@dataclass(frozen=True)
class SystemText:
    """Content of a system file."""

    name: str
    text: str
    data: dict[str, Any]  # the parsed TOML
    folder: Path  # folder of its structure files

    def identity(self) -> str:
        """Text that identifies the file's content."""
        return file_identity(self.text, self.data, self.folder)

    def system(self, values: Mapping[str, Any], seed: int, with_source: bool = True) -> System | Problem:
        """System with these values in its file. With ``source``, the file's text is written anew."""
        import tomli_w

        data = with_values(self.data, dict(values))
        text = tomli_w.dumps(data) if with_source else ""
        return with_noise(built(data, self.name, None if seeded(values) else seed, self.folder, text), seed)


@dataclass(frozen=True)
class SystemMaker:
    """A System, or a function that makes a System from the varied values."""

    name: str
    made: System | Problem | Callable[..., System | Problem]

    @property
    def text(self) -> str:
        """Text of the system file behind the System, if any."""
        return "" if callable(self.made) else self.made.source

    def identity(self) -> str:
        """Text that identifies the System or function."""
        return function_identity(self.made) if callable(self.made) else system_identity(self.made)

    def system(self, values: Mapping[str, Any], seed: int, with_source: bool = True) -> System | Problem:
        """System that the function makes from these values. Keys of ``[run]`` are passed only if it has such
        parameters."""
        made: Any = self.made
        taken = inspect.signature(made).parameters if callable(made) else {}
        rest = {key: value for key, value in values.items() if key not in taken}
        run = {path_of(key)[-1]: value for key, value in rest.items() if path_of(key)[:-1] == ("run",)}
        for key in rest:
            if path_of(key)[:-1] != ("run",):
                whose = f"{self.name}() has no such parameter" if callable(made) else "a System cannot vary this key"
                raise InputError(f"vary: {key}: {whose}; expected dt, integrator or another key of [run]")
        if callable(made):
            own = {key: value for key, value in values.items() if key in taken}
            made = made(**own, **({"seed": seed} if "seed" in taken and "seed" not in own else {}))
            if not isinstance(made, System | Problem):
                raise InputError(f"{self.name}(): returned a {type(made).__name__}, expected a System")
        return with_noise(made.with_run(**run), seed)


@dataclass(frozen=True)
class Recipe:
    """System, work and measure of every member.

    Attributes
    ----------
    subject : source of the systems
    settings : keys of the file or of ``[run]`` with values that all members share
    measure : RUN, MEGNO, or a function of the Simulation after its run
    trajectories : a folder for the members' files, or None
    methods : integrators outside kickdrift, which are sent by value
    files : Python files that register others, or functions that the system names as forces
    modules : modules of calculators that the system names, and this program has loaded
    in_turns : whether members of a task ask a Python function or a calculator together
    """

    subject: SystemText | SystemMaker
    settings: Mapping[str, Any] = field(default_factory=dict)
    measure: str | Measure = RUN
    trajectories: Path | None = None
    methods: tuple[Method, ...] = ()
    files: tuple[Path, ...] = ()
    modules: tuple[str, ...] = ()
    in_turns: bool = False

    def system(self, member: Member) -> System | Problem:
        """System of a member."""
        with_source = self.trajectories is not None or callable(self.measure)
        return self.subject.system(self._values(member), member.seed, with_source)

    def _values(self, member: Member) -> dict[str, Any]:
        """Values by key, of all members and of this one; options of an integrator stand beside its name."""
        found = dict(self.settings)
        for key in sorted(member.values, key=lambda key: path_of(key) != INTEGRATOR):  # an option beside it wins
            value = member.values[key]
            if path_of(key) == INTEGRATOR and isinstance(value, str):
                value, options = from_text(value)
                found |= options
            found[key] = value
        return found

    def carrier(self, member: Member) -> str | None:
        """Integrator for `megno`; None if only the system's own file names one, which may carry no variations."""
        return {path_of(key): value for key, value in self._values(member).items()}.get(INTEGRATOR)

    @property
    def drawn(self) -> bool:
        """Tell whether members with the same values differ by their seeds, as far as this is known."""
        if self.measure == MEGNO:
            return True
        if isinstance(self.subject, SystemText):
            run = self.subject.data.get("run")
        else:
            run = None if callable(self.subject.made) else self.subject.made.run.said()
        named = (run if isinstance(run, dict) else {}) | {
            path_of(key)[-1]: value for key, value in self.settings.items() if path_of(key)[0] == "run"
        }
        if draws_noise(RunDefaults(**named)):
            return True
        if isinstance(self.subject, SystemText):
            return draws(self.subject.data)
        return callable(self.subject.made) and "seed" in inspect.signature(self.subject.made).parameters

    def begin(self) -> None:
        """Register the integrators in a new process."""
        with _LOADING:
            for method in self.methods:
                INTEGRATORS[method.name] = method
            for path in self.files:
                if path not in _LOADED:
                    load_file(path)
                    _LOADED.add(path)
            for module in self.modules:
                load_module(module)

    @property
    def measure_name(self) -> str:
        """The measure in one word."""
        return self.measure if isinstance(self.measure, str) else getattr(self.measure, "__name__", "measure")

    def knowing(self, methods: Iterable[Method], system: System | Problem) -> Recipe:
        """Copy for members that name these integrators, and whose systems have the forces of this one. Coefficients,
        and a step in the user's script, are sent by value; a step in a file is loaded from the file."""
        found, files = [], set()
        for method in methods:
            step = getattr(method, "function", None)
            if step is None or step.__module__ == "__main__":
                found.append(method)
            else:
                files.add(Path(inspect.getfile(step)).resolve())
        forces = self.subject.data.get("force", []) if isinstance(self.subject, SystemText) else []
        homes = [home_of(force.get(key)) for force in forces for key in ("function", "calculator")]
        files |= {home for home in homes if isinstance(home, Path)}
        modules = sorted({home for home in homes if isinstance(home, str)})
        together = self.measure != MEGNO and any(
            getattr(force, "batch", False) for force in getattr(system, "forces", ())
        )
        return replace(
            self, methods=tuple(found), files=tuple(sorted(files)), modules=tuple(modules), in_turns=together
        )

    def writing(self, trajectories: str | os.PathLike[str]) -> Recipe:
        """Copy with a file for each member in that folder, which is made if needed."""
        folder = Path(trajectories).resolve()
        if self.measure == MEGNO:
            raise InputError("trajectories: megno writes no frames; expected measure 'run' or a function")
        try:
            folder.mkdir(exist_ok=True)
        except OSError as error:
            raise InputError(f"trajectories {trajectories}: cannot be made: {reason(error)}") from None
        return replace(self, trajectories=folder)

    def refuse_frames(self, overwrite: bool) -> None:
        """Refuse frames of other members in the folder of trajectories."""
        there = sorted(self.trajectories.glob("member-*.h5*")) if self.trajectories and not overwrite else []
        if there:
            raise InputError(f"trajectories: {there[0]} exists already; give another folder, or --overwrite")

    def identity(self) -> dict[str, str]:
        """Identity of the members, as short texts by name."""
        files = [path.read_bytes() for path in self.files]
        return {
            "system": self.subject.identity(),
            "settings": repr(sorted(self.settings.items())),
            "measure": self.measure if isinstance(self.measure, str) else function_identity(self.measure),
            "integrator": digest(*map(repr, self.methods), *files) if self.methods or files else "",
            "trajectories": "yes" if self.trajectories else "no",
        }


def with_noise(system: System | Problem, seed: int) -> System | Problem:
    """The system with this seed in ``[run]``, if its integrator draws random numbers and has no seed there."""
    return system.with_run(seed=seed) if draws_noise(system.run) else system


def seeded(values: Iterable[str]) -> bool:
    """Tell whether a seed of the system itself is varied."""
    return any(path_of(key)[0] in ("velocities", "particles") and path_of(key)[-1] == "seed" for key in values)


def digest(*parts: str | bytes) -> str:
    """Short digest of long texts."""
    found = hashlib.sha256()
    for part in parts:
        found.update(part.encode() if isinstance(part, str) else part)
        found.update(b"\0")
    return found.hexdigest()


def file_identity(text: str, data: Mapping[str, Any], folder: Path) -> str:
    """Identity of a system file and its structure file, if any."""
    particles = data.get("particles")
    named = particles.get("file") if isinstance(particles, Mapping) else None
    path = folder / named if isinstance(named, str) else None
    return digest(text, path.read_bytes() if path and path.is_file() else b"")


def system_identity(system: System | Problem) -> str:
    """Identity of a System or a Problem."""
    from kickdrift.trajectory.layout.record import record_of, run_record, to_json

    if isinstance(system, Problem):
        said = to_json([system.name, system.equation, system.parameters, run_record(system.run), system.t0])
        return digest(said, system.y0.tobytes(), function_identity(system.f))
    state = system.state
    arrays = (state.phase, state.masses, state.ids, system.species_index)
    return digest(to_json(record_of(system)), *(array.tobytes() for array in arrays))


def function_identity(function: Callable[..., Any]) -> str:
    """Identity of a function: its source, closure and defaults, and the functions of its module that it calls."""
    return digest(*_parts(function, set()))


def _parts(thing: Any, seen: set[int]) -> list[str]:
    if isinstance(thing, partial):
        return [*_parts(thing.func, seen), *_parts([*thing.args, *sorted(thing.keywords.items())], seen)]
    if isinstance(thing, list | tuple):
        return [part for each in thing for part in _parts(each, seen)]
    thing = getattr(thing, "py_func", thing)  # the source of a compiled function
    if isinstance(thing, np.ndarray):
        return [digest(str(thing.dtype), str(thing.shape), thing.tobytes())]
    if not isinstance(thing, FunctionType):
        shown = repr(thing)
        return [type(thing).__qualname__ if " at 0x" in shown or isinstance(thing, ModuleType) else shown]
    if id(thing) in seen:
        return [thing.__qualname__]
    seen.add(id(thing))
    found = [_source(thing), *_parts(list(thing.__defaults__ or ()), seen)]
    found += _parts(sorted((thing.__kwdefaults__ or {}).items()), seen)
    found += _parts(list(inspect.getclosurevars(thing).nonlocals.items()), seen)
    around = {name: thing.__globals__[name] for name in sorted(_names(thing.__code__)) if name in thing.__globals__}
    for name, value in around.items():
        if not isinstance(value, FunctionType) or value.__module__ == thing.__module__:
            found += [name, *_parts(value, seen)]
    return found


def _names(code: CodeType) -> set[str]:
    """Global names that code, and nested code, may use."""
    inner = [each for each in code.co_consts if isinstance(each, CodeType)]
    return set(code.co_names).union(*map(_names, inner))


def _source(function: FunctionType) -> str:
    try:
        return inspect.getsource(function)
    except (OSError, TypeError, SyntaxError, TokenError):  # no source, or the file has changed since
        return function.__qualname__ + function.__code__.co_code.hex()
