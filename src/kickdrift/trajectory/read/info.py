"""Content of a run's file and its box over time, as a dictionary and as text. The file is only read, never repaired."""

from __future__ import annotations

import math
import os
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces import force_class
from kickdrift.integrators import INTEGRATORS
from kickdrift.looks.doubts import of_samples
from kickdrift.looks.record import even_stretch
from kickdrift.looks.report_lines import mean_text, mean_with_units
from kickdrift.model.box.box import Box
from kickdrift.model.checks.limits import NEVER
from kickdrift.model.event_log import event_lines
from kickdrift.model.molecules.topology import counts_text
from kickdrift.model.state import Floats
from kickdrift.model.units.unit_systems import symbol_of
from kickdrift.statistics.blocks import block_average
from kickdrift.text import choices, clean, counted, measured, shown
from kickdrift.trajectory.read.reader import Run, open
from kickdrift.trajectory.read.recorded import Recorded
from kickdrift.trajectory.read.universe import topology_of

VOLUME = "volume"  # a column of the samples of a run with a barostat
SHOWN = 5  # most unregistered forces that are listed
WIDTH = 60  # largest width of the column of keys
_METHOD_FIRST = ("engine", "engine_version", "processes", "integrator", "dt", "threads", "seed")
MOST_SHOWN = 12  # values of a list
RANGES = 20  # most stretches of damaged rows that are listed
_SHOWN_UNITS = ("length", "time", "energy")
_METHOD_SHOWN = (*_METHOD_FIRST, "options")  # all other keys repeat one of these


class Room(NamedTuple):
    """The box of each whole frame.

    Attributes
    ----------
    steps, times : (f,) of the frames
    lengths : (f, 3) diagonals of the edge vectors: the edge lengths of a rectangular box
    volume : (f,) volumes, in two dimensions areas
    density : (f,) particles per volume or area
    """

    steps: NDArray[np.int64]
    times: Floats
    lengths: Floats
    volume: Floats
    density: Floats


def room_of(run: Run) -> Room | None:
    """The box over time; None if all frames have the box of the run's System, or if the box has no volume."""
    steps, times, boxes = run.whole_boxes()
    plane = run.system_record.get("dimensions") == 2
    if not run.box_varies or not boxes:
        return None
    volume = np.array([box.area if plane else box.volume for box in boxes])
    if not np.isfinite(volume).all():
        return None
    lengths = np.array([np.diag(box.matrix) for box in boxes])
    return Room(steps, times, lengths, volume, len(run.ids) / volume)


def means_of(run: Run) -> dict[str, dict[str, float | None]]:
    """Mean volume and density with standard errors (None if the run is too short): over the samples if these have the
    volume, else over the frames. Empty for a box that is fixed or open."""
    room, samples = room_of(run), run.whole_samples()
    if VOLUME in samples.observables:
        steps, volume = samples.steps, samples.observables[VOLUME]
    elif room is not None:
        steps, volume = room.steps, room.volume
    else:
        return {}
    return {"volume": _mean(steps, volume), "density": _mean(steps, len(run.ids) / volume)}


def _mean(steps: NDArray[np.int64], values: Floats) -> dict[str, float | None]:
    error = float(block_average(values[even_stretch(steps)]).error)
    return {"mean": float(values.mean()), "error": error if np.isfinite(error) else None}


def info(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Content of a run's file in numbers. Raises InputError if the file is not a run's file."""
    with open(path) as run:
        return info_of(run)


def info_of(run: Run) -> dict[str, Any]:
    """The same of an open file."""
    counts = {name: int((run.species_index == index).sum()) for index, name in enumerate(run.species)}
    return shared_content(run) | {
        "system": run.system_record.get("name"),
        "particles": len(run.ids) - run.system_record.get("room", 0),
        "species": counts,
        **({} if (joined := topology_of(run)) is None else {"topology": joined.counts()}),
        **ties_of(run),
        "box": None if run.box.shape is None else np.array(run.box.shape).tolist(),
        "periodic": list(run.box.periodic_axes),
        **means_of(run),
        "units": {
            "name": run.units.name,
            "length": run.units.length,
            "time": run.units.time,
            "energy": run.units.energy,
            "temperature": run.units.temperature,
            "charge": run.units.charge,
            "nominal": run.nominal_units,
        },
        "unregistered": _unregistered(run),
        "frames": len(run),
        "precision": run.options.store,
        "write": list(run.options.write),
        "compressed": run.packed,
        "compress": run.options.compress,
    }


def ties_of(run: Run) -> dict[str, Any]:
    """Net charge, and numbers of rigid distances, of virtual sites and of fixed particles, of a run that has them."""
    found: dict[str, Any] = {} if run.charges is None else {"net_charge": math.fsum(run.charges)}
    for key, items in (("constraints", "pairs"), ("virtual_sites", "particles"), ("fixed", "particles")):
        tables = run.system_record.get(key)
        given = [each.get(items) for each in tables if isinstance(each, dict)] if isinstance(tables, list) else []
        if count := sum(len(each) for each in given if isinstance(each, list)):
            found[key] = count
    return found


def tie_lines(found: dict[str, Any], charge: str) -> list[tuple[str, str]]:
    """Rows of key and text from the result of `ties_of`, with the unit of charge."""
    rows = []
    if "net_charge" in found:
        rows.append(("net charge", measured(f"{found['net_charge']:.6g}", charge)))
    for key, name in (("constraints", "rigid distance"), ("virtual_sites", "site"), ("fixed", "particle")):
        if key in found:
            rows.append((key.replace("_", " "), counted(found[key], name, ",")))
    return rows


def shared_content(run: Recorded) -> dict[str, Any]:
    """Content that the files of particles and of Problems share, in numbers."""
    samples = run.whole_samples()
    return {
        "file": str(run.path),
        "bytes": run.path.stat().st_size,
        "kickdrift": run.versions.get("kickdrift"),
        "method": run.method,
        "every": run.every,
        "samples": run.committed.samples,
        "steps": [int(samples.steps[0]), int(samples.steps[-1])] if len(samples.steps) else None,
        "time": [float(samples.times[0]), float(samples.times[-1])] if len(samples.times) else None,
        "observables": {
            name: {"first": values[0].tolist(), "last": values[-1].tolist()}
            for name, values in samples.observables.items()
            if len(values)
        },
        "columns": {name: {"shape": list(shape), "unit": unit} for name, (shape, unit) in run.columns.items()},
        "checkpoints": [] if run.checkpoints is None else run.checkpoints.steps.tolist(),
        "plan": run.plan,
        "unchanged": run.unchanged,
        "damaged": run.damage()._asdict(),
        "stopped": (run.report or {}).get("stopped", ""),
        "closed": run.closed,
        "half_written": run.half_written,
        "events": run.whole_events(),
        "report": run.report,
        "warnings": warnings_of(run),
    }


def warnings_of(run: Recorded) -> list[str]:
    """Warnings of the run's report; without a report, the warning that its samples give of the energy."""
    if run.report is not None:
        return list(run.report.get("warnings", ()))
    seen, method = run.whole_samples().observables, INTEGRATORS.get(str(run.method.get("integrator")))
    total = seen.get("total_energy", seen.get("energy"))
    if total is None or not len(total) or method is None or method.bath or _works(run):
        return []
    doubt = of_samples(total + seen.get("energy_taken", 0.0), seen.get("kinetic_energy", np.full(len(total), np.nan)))
    return [doubt] if doubt else []


def _works(run: Recorded) -> bool:
    """Whether a force of the run, or a fixed particle that moves, may do work, so that its energy is not conserved."""
    fixed = getattr(run, "system_record", {}).get("fixed")
    if isinstance(fixed, list) and any(isinstance(each, dict) and each.get("velocity") for each in fixed):
        return True
    classes = [force_class(*name) for name in _forces_of(run)]
    return any(cls is None or getattr(cls, "works", False) for cls in classes)  # a property is true, too


def _forces_of(run: Recorded) -> list[tuple[str, str]]:
    """Module and name of each kind of force that the file names."""
    given = getattr(run, "system_record", {}).get("forces")
    listed = [each for each in given if isinstance(each, dict)] if isinstance(given, list) else []
    return list(dict.fromkeys((str(each.get("module")), str(each.get("type"))) for each in listed))


def _unregistered(run: Run) -> list[str]:
    """Forces that the file names and that are not registered. Their modules are not searched."""
    unknown = [name for name in _forces_of(run) if force_class(*name) is None]
    return [shown(".".join(name))[1:-1] for name in unknown[:SHOWN]]


def describe(found: dict[str, Any]) -> str:
    """Text for a reader from the result of `info`."""
    return laid_out(found, described(found))


def laid_out(found: dict[str, Any], rows: list[tuple[str, str]]) -> str:
    """Rows of key and text as lines below the file's name."""
    width = min(WIDTH, max(len(key) for key, _ in rows))
    lines = [found["file"], *(f"  {key:<{width}}  {value}".rstrip() for key, value in rows)]
    return "\n".join(clean(line) for line in lines)


def described(found: dict[str, Any]) -> list[tuple[str, str]]:
    """Rows of key and text from the result of `info`."""
    units = found["units"]
    length, time, energy = (symbol_of(units[key]) for key in ("length", "time", "energy"))
    named = [f"{key} {symbol}" for key, symbol in zip(_SHOWN_UNITS, (length, time, energy), strict=True) if symbol]
    species = choices(f"{count:,} {name}" for name, count in found["species"].items())
    rows = [
        ("system", found["system"]),
        ("particles", f"{found['particles']:,} ({species})"),
        *([("topology", counts_text(found["topology"]))] if "topology" in found else []),
        *tie_lines(found, symbol_of(units["charge"])),
        ("box", _box(found["box"], found["periodic"], length) + " at the start" * ("volume" in found)),
        *room_lines(found, length),
        ("units", f"{units['name']}: {', '.join(named) or 'plain numbers'}"),
    ]
    if units["nominal"]:
        one = (f"1 {length or 'unit of length'}", f"1 {time or 'unit of time'}")
        rows.append(("", f"other programs see {one[0]} as 1 angstrom and {one[1]} as 1 ps"))
    rows += method_rows(found["method"])
    rows.append(("frames", f"{found['frames']:,}, and {found['samples']:,} samples of the observables"))
    if found["time"]:
        first, last = found["time"]
        rows.append(
            ("time", f"{first:g} to {measured(f'{last:g}', time)}, steps {found['steps'][0]} to {found['steps'][1]}")
        )
    for name, ends in found["observables"].items():
        unit = symbol_of(found["columns"].get(name, {}).get("unit", ""))
        shown_name = name if name in found["columns"] else name.replace("_", " ")
        if name == "pressure":
            per = symbol_of(f"{units['energy']}/{units['length']}^{sum(found['periodic'])}")
            rows.append((name, f"{short(ends['first'])} → {mean_with_units(ends['last'], None, per)}"))
            continue
        rows.append((shown_name, f"{short(ends['first'])} → {measured(short(ends['last']), unit)}"))
    rows.append(("", _form(found)))
    return with_end(found, rows)


def room_lines(found: dict[str, Any], length: str) -> list[tuple[str, str]]:
    """Mean volume and density of a box that varies, with their standard errors."""
    axes = sum(found["periodic"])
    powers = {"volume": f"{length}^{axes}" if length else "", "density": f"{length}^-{axes}" if length else ""}
    return [
        (name, mean_text(found[name]["mean"], found[name]["error"], unit))
        for name, unit in powers.items()
        if name in found
    ]


def method_rows(method: dict[str, Any]) -> list[tuple[str, str]]:
    """Facts in a file about its Simulation, by key."""
    rows = [(key, short(method[key])) for key in _METHOD_FIRST if method.get(key) is not None]
    return rows + [(k, short(value)) for k, value in method.items() if k not in _METHOD_SHOWN and value is not None]


def with_end(found: dict[str, Any], rows: list[tuple[str, str]]) -> list[tuple[str, str]]:
    """Rows of key and text, and the rows that every run has."""
    rows.append(("written by", f"kickdrift {found['kickdrift']}, {found['bytes']:,} bytes"))
    rows.append(("closed", _ending(found)))
    if ahead := goal(found):
        rows.append(("", f"{ahead}; kickdrift resume goes on"))
    rows += alarms(found)
    rows.append(("checkpoints", _checkpoints(found["checkpoints"])))
    report = found["report"] or {}
    report = {key: value for key, value in report.items() if key not in ("events", "warnings")}
    rows += [(f"report: {key.replace('_', ' ')}", short(value)) for key, value in _flat(report)]
    return rows + event_lines(found["events"])


def alarms(found: dict[str, Any]) -> list[tuple[str, str]]:
    """Rows of key and text about what is wrong with a file, and what a run needs before it can go on."""
    rows = [
        ("force", f"{force} is registered nowhere: resume needs a program that registers the class")
        for force in found.get("unregistered", ())
    ]
    if not found["unchanged"]:
        what = "problem" if "problem" in found else "system"
        rows.append((what, "was changed after the run began, by its hash: the run cannot go on"))
    rows += [("warning", line) for line in found["warnings"]]
    return rows + _damaged(found["damaged"], found["frames"])


def _box(shape: list[Any] | None, periodic: list[bool], unit: str) -> str:
    if shape is None:
        return "open"
    edges, _, along = Box(shape, periodic=periodic).described(unit).partition(", periodic")
    return f"{edges.replace(' x ', ' × ')}, periodic{along}"


def _form(found: dict[str, Any]) -> str:
    """Vectors in each frame and the form in which they are stored."""
    vectors = ", ".join(["positions", "velocities", *(name for name in found["write"] if name != "images")])
    text = f"{vectors} in {found['precision']}" + (", images in int32" if "images" in found["write"] else "")
    if found["compressed"]:
        return text + ", compressed"
    return text + (", not compressed, since the run did not finish" if found["compress"] else "")


def _ending(found: dict[str, Any]) -> str:
    if found["closed"]:
        return "properly, with a report"
    text = "not properly: the run did not finish, and there is no report"
    left = [counted(count, name.removesuffix("s")) for name, count in found["half_written"].items() if count]
    if left:
        *first, last = left
        names = f"{', '.join(first)} and {last}" if first else last
        text += f"; behind the last whole ones, {names} were left half written"
    return text


def _damaged(damage: dict[str, Any], frames: int) -> list[tuple[str, str]]:
    """Damaged parts, and frames without a checksum."""
    unchecked = damage["unchecked"]
    found = {what: _ranges(numbers) for what, numbers in damage.items() if what != "unchecked" and numbers}
    rows = [("damaged", f"{what}{' of step' * (what == 'checkpoints')} {text}") for what, text in found.items()]
    if unchecked:
        which = "no frame has one" if unchecked == frames else f"{counted(unchecked, 'frame')} without"
        rows.append(("checksums", f"{which}, since an older kickdrift wrote them: damage there goes unnoticed"))
    return rows


def _ranges(numbers: list[int]) -> str:
    """Numbers as text: "3, 7 to 9"."""
    runs: list[list[int]] = []
    for number in numbers:
        if runs and number == runs[-1][1] + 1:
            runs[-1][1] = number
        else:
            runs.append([number, number])
    texts = [str(first) if first == last else f"{first} to {last}" for first, last in runs]
    return ", ".join(texts[:RANGES]) + (f" and {len(texts) - RANGES} more stretches" if len(texts) > RANGES else "")


def goal(found: dict[str, Any]) -> str:
    """Planned length of a run that has not reached it."""
    if not found["plan"] or not found["steps"]:
        return ""
    _, begin_time, end_step, end_time, *_ = found["plan"]
    step, time = found["steps"][1], found["time"][1]
    there = time >= end_time if end_time >= begin_time else time <= end_time
    if step >= end_step or there or found["stopped"]:
        return ""
    if end_step < NEVER:
        return f"step {step:,} of {int(end_step):,}"
    return f"time {time:.9g} of {measured(f'{end_time:.9g}', symbol_of(found['units']['time']))}"


def _checkpoints(steps: list[int]) -> str:
    if not steps:
        return "none: the run cannot be taken up again, but a new one can begin at a frame"
    return f"{len(steps)}, of step {steps[0]}" + (f" to {steps[-1]}" if len(steps) > 1 else "")


def _flat(report: dict[str, Any], prefix: str = "") -> list[tuple[str, Any]]:
    rows: list[tuple[str, Any]] = []
    for key, value in report.items():
        rows += _flat(value, f"{prefix}{key} ") if isinstance(value, dict) else [(prefix + key, value)]
    return rows


def short(value: Any) -> str:
    """A value as text, a list in brackets; a long list is cut."""
    if isinstance(value, float):
        return f"{value:.8g}"
    if isinstance(value, list) and len(value) > MOST_SHOWN:
        return f"{short(value[:6])[:-1]}, … {len(value)} values)"
    if isinstance(value, list):
        return "(" + ", ".join(short(item) for item in value) + ")"
    return str(value)
