"""Files of force fields through OpenMM's readers: AMBER, GROMACS, CHARMM, and PDB with force fields in XML."""

from __future__ import annotations

import os
import traceback
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

import openmm.app as app
from openmm import unit

from kickdrift.errors import InputError
from kickdrift.model.starts.gro import refuse_cut
from kickdrift.systemfile.files import prefixed
from kickdrift.text import choices, clean, shown

CUTOFF = 1.0  # nm, as OpenMM's own default
RIGID: dict[str, dict[str, Any]] = {  # what a run keeps rigid
    "hydrogen": {"constraints": app.HBonds, "rigidWater": True},
    "water": {"constraints": None, "rigidWater": True},
    "none": {"constraints": None, "rigidWater": False},
}
FRAMES: dict[str, Callable[[str], Any]] = {  # readers of coordinates
    ".inpcrd": app.AmberInpcrdFile, ".rst7": app.AmberInpcrdFile, ".rst": app.AmberInpcrdFile,
    ".gro": app.GromacsGroFile, ".crd": app.CharmmCrdFile, ".pdb": app.PDBFile, ".cif": app.PDBxFile,
}  # fmt: skip
INNER = (AttributeError, IndexError, KeyError, TypeError, StopIteration)  # readers did not mean to raise these
CUT = ("invalid literal", "could not convert", "Illegal line", "Too few fields")  # begin errors of damaged files
EVALUATED = "useDispersionCorrection"  # attribute whose text OpenMM's reader of XML evaluates as Python


class Parts(NamedTuple):
    """OpenMM's objects of a system."""

    system: Any
    topology: Any
    positions: Any
    velocities: Any


class Asked(NamedTuple):
    """What a user asks of a system's files; see `kickdrift.load`."""

    coordinates: str | os.PathLike[str] | None
    force_field: Sequence[str]
    cutoff: float | None = None
    rigid: str | None = None


def read(path: Path, asked: Asked) -> Parts:
    """Return OpenMM's objects of the system in a file of parameters, or in a structure with a force field."""
    if asked.rigid is not None and asked.rigid not in RIGID:
        raise InputError(f"rigid: expected {choices(RIGID)}, got {shown(asked.rigid)}")
    with told():
        return READERS[path.suffix.lower()](path, asked)


@contextmanager
def told(what: str = "") -> Iterator[None]:
    """Context in which any error of OpenMM's readers becomes an InputError of one line, which begins with ``what``.
    Readers leave files open, and Python closes these here without a warning."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ResourceWarning)
        try:
            yield
        except InputError:
            raise
        except Exception as error:  # readers raise many kinds
            text = clean(" ".join(str(error).split()), 300)
            if isinstance(error, INNER) or text.startswith(CUT):
                text = f"it may be cut off or damaged ({type(error).__name__}: {text})"
            traceback.clear_frames(error.__traceback__)
            raise InputError(f"{what}OpenMM cannot take it: {text}") from None


def _frame(path: Path, asked: Asked) -> Any:
    """OpenMM's reader of the coordinates, with `positions`."""
    assert asked.coordinates is not None
    where = Path(asked.coordinates)
    if where.suffix.lower() not in FRAMES:
        raise InputError(f"{where}: coordinates come from files that end in {choices(FRAMES)}")
    if not where.is_file():
        raise InputError(f"{where}: no such file")
    if where.suffix.lower() == ".gro":
        with prefixed(f"{where}: "):
            refuse_cut(where)
    with told(f"{where}: "):
        return FRAMES[where.suffix.lower()](str(where))


def _edges(frame: Any) -> Any:
    """Box vectors of a frame; None in open space."""
    found = getattr(frame, "boxVectors", None)
    if found is None and hasattr(frame, "getPeriodicBoxVectors"):
        found = frame.getPeriodicBoxVectors()
    if found is None and hasattr(frame, "topology"):
        found = frame.topology.getPeriodicBoxVectors()
    return None if found is None or not any(unit.norm(row)._value for row in found) else found  # zeros in a .gro


def _settings(asked: Asked, periodic: bool) -> dict[str, Any]:
    """Arguments of OpenMM's ``createSystem``: PME in a periodic box, all pairs in open space."""
    cutoff = (CUTOFF if asked.cutoff is None else asked.cutoff) * unit.nanometer
    pairs = {"nonbondedMethod": app.PME, "nonbondedCutoff": cutoff} if periodic else {"nonbondedMethod": app.NoCutoff}
    return {**RIGID[asked.rigid or "hydrogen"], "removeCMMotion": False, **pairs}


def _amber(path: Path, asked: Asked) -> Parts:
    frame = _frame(path, asked)
    edges = _edges(frame)
    found = app.AmberPrmtopFile(str(path), periodicBoxVectors=edges)
    periodic = found.topology.getPeriodicBoxVectors() is not None
    made = found.createSystem(**_settings(asked, periodic))
    return Parts(made, found.topology, frame.positions, getattr(frame, "velocities", None))


def _gromacs(path: Path, asked: Asked) -> Parts:
    frame = _frame(path, asked)
    edges = _edges(frame)
    folder = {"includeDir": asked.force_field[0]} if asked.force_field else {}
    found = _top(path, periodicBoxVectors=edges, **folder)
    made = found.createSystem(**_settings(asked, edges is not None))
    return Parts(made, found.topology, frame.positions, None)


def _top(path: Path, **given: Any) -> Any:
    """OpenMM's reader of a .top. Raises InputError for one that ends early."""
    try:
        found = app.GromacsTopFile(str(path), **given)
    except AttributeError:  # of the reader's own, which [ defaults ] would have set
        found = None
    if found is None or not found.topology.getNumAtoms():
        lacks = "[ defaults ], or includes none" if found is None else "[ molecules ] with a molecule"
        raise InputError(f"is no whole .top file: it has no {lacks}")
    return found


def _charmm(path: Path, asked: Asked) -> Parts:
    if not asked.force_field:
        raise InputError("needs CHARMM's files of parameters: force_field (--force-field)")
    frame = _frame(path, asked)
    edges = _edges(frame)
    found = app.CharmmPsfFile(str(path), periodicBoxVectors=edges)
    made = found.createSystem(app.CharmmParameterSet(*asked.force_field), **_settings(asked, edges is not None))
    return Parts(made, found.topology, frame.positions, None)


def _structure(path: Path, asked: Asked) -> Parts:
    if not asked.force_field:
        raise InputError("needs the files of a force field: force_field (--force-field), in a system file files")
    force_field = app.ForceField(*_checked([os.fspath(file) for file in asked.force_field]))
    found = FRAMES[path.suffix.lower()](str(path))
    periodic = found.topology.getPeriodicBoxVectors() is not None
    made = force_field.createSystem(found.topology, **_settings(asked, periodic))
    return Parts(made, found.topology, found.positions, None)


def _checked(files: list[str]) -> list[Any]:
    """Force fields in XML and those that they include, each checked, as OpenMM's ForceField takes them. OpenMM reads
    what was checked, because no file that it gets includes another."""
    folders = [os.path.abspath(folder) for folder in app.forcefield._getDataDirectories()]
    queue, found = [_place(file, folders) for file in files], list[Any]()
    for path in queue:  # grows by the files that are included, in OpenMM's order
        root = ElementTree.parse(path).getroot()
        if not any(path.startswith(folder + os.sep) for folder in folders):
            _refuse_code(path, root)
        included = root.findall("Include")
        for element in included:
            inner = _place(element.attrib.get("file", ""), folders, os.path.dirname(path))
            queue += [] if inner in queue else [inner]
            root.remove(element)
        found.append(BytesIO(ElementTree.tostring(root)) if included else path)
    return found


def _place(file: str, folders: Iterable[str], *beside: str) -> str:
    """Path of a force field: ``beside`` the file that includes it, in the working folder, or where OpenMM ships it."""
    paths = [os.path.abspath(os.path.join(folder, file)) for folder in (*beside, "", *folders)]
    path = next(filter(os.path.isfile, paths), None)
    if path is None:
        raise InputError(f"force field {shown(file)}: no such file, and OpenMM ships none of this name")
    return path


def _refuse_code(file: str, root: ElementTree.Element) -> None:
    """Refuse a user's force field with text that OpenMM would run as Python: scripts, and a value that it evaluates.
    Files that OpenMM ships may have scripts."""
    for element in root.iter():
        if element.tag in ("Script", "InitializationScript"):
            raise InputError(f"{file}: has a script, which OpenMM would run as Python; remove it")
        value = element.attrib.get(EVALUATED)
        if value not in (None, "True", "False", "0", "1"):
            raise InputError(f"{file}: {EVALUATED}: expected True, False, 0 or 1, got {shown(value)}")


READERS: dict[str, Callable[[Path, Asked], Parts]] = {
    ".prmtop": _amber, ".parm7": _amber, ".top": _gromacs, ".psf": _charmm, ".pdb": _structure, ".cif": _structure,
}  # fmt: skip
