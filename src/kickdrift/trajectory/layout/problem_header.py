"""Facts that stand once in the file of a Problem's run, checked. Samples and checkpoints are as in every file."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from kickdrift.model.box.box import Box
from kickdrift.model.state import Floats
from kickdrift.model.units.unit_systems import UNIT_SYSTEMS
from kickdrift.trajectory.layout import header, stored
from kickdrift.trajectory.layout.contents import Contents
from kickdrift.trajectory.layout.options import FileOptions

PROBLEM = "kickdrift/problem"
Y, ENERGY = "y", "energy"  # the series that kickdrift itself writes


@dataclass(frozen=True, kw_only=True)
class ProblemHeader(header.Outline):
    """See `ProblemRun` for what is public there."""

    run_id: str
    every: int
    record: dict[str, Any]
    source: str
    y0: Floats
    method: dict[str, Any]
    versions: dict[str, Any]
    report: dict[str, Any] | None
    half_written: dict[str, int]


def _outline(committed: header.Committed, observables: tuple[str, ...]) -> dict[str, Any]:
    """The parts of an outline that no Problem has, and those given."""
    return {
        "units": UNIT_SYSTEMS["nbody"],  # plain numbers
        "box": Box(None),
        "ids": np.zeros(0, "i8"),
        "options": FileOptions(),
        "committed": committed,
        "vectors": (),
        "observables": observables,
    }


def outline() -> header.Outline:
    """That of a new file."""
    return header.Outline(**_outline(header.Committed(0, 0, 0), ()))


def read(contents: Contents) -> ProblemHeader:
    """Return the checked header. Raises InputError that names the fault."""
    own = "kickdrift"
    record = stored.read(contents, f"{PROBLEM}/record", stored.ProblemText)
    n = record["unknowns"]
    frames, samples, events = counts = contents.array(f"{own}/committed", "i8", (3,)).tolist()
    if min(counts) < 0 or frames:
        raise contents.damaged(f"{own}/committed: expected no frames and two counts, got {counts}")
    clock = [header.sampled(contents, key, samples) for key, _ in header.CLOCK]
    observables = header.named(contents)
    if samples and (Y not in observables or header.shape_of(contents, Y) != (n,)):
        raise contents.damaged(f"kickdrift/samples: expected a series {Y} of {n} numbers")
    if ENERGY in observables and header.shape_of(contents, ENERGY):
        raise contents.damaged(f"kickdrift/samples/{ENERGY}: expected one number for each sample")
    closed = bool(contents.array(f"{own}/closed", "i1", (1,))[0])
    return ProblemHeader(
        **_outline(header.Committed(frames, samples, events), observables),
        run_id=contents.attribute(own, "run_id", str),
        every=contents.attribute(own, "every", int),
        record=record,
        source=contents.text(f"{PROBLEM}/source"),
        y0=contents.array(f"{PROBLEM}/y0", "f8", (n,)),
        method=stored.read(contents, f"{own}/method", stored.MethodText),
        versions=stored.read(contents, f"{own}/versions", stored.VersionsText),
        report=header.report_of(contents) if closed else None,
        half_written={
            "samples": clock[0].shape[0] - samples,
            "events": header.event_column(contents, "step", events).shape[0] - events,
        },
    )
