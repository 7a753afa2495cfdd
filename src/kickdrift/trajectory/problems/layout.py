"""The first bytes of the file of a Problem's run; ``docs/file-format.md`` describes the whole."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from typing import Any

import h5py

from kickdrift.model.problem import Problem
from kickdrift.trajectory.layout import checkpoints, checksums
from kickdrift.trajectory.layout.checkpoints import Stored
from kickdrift.trajectory.layout.names import add_method, add_text, hashed, image, new_counts, new_run, new_samples
from kickdrift.trajectory.layout.problem_header import PROBLEM
from kickdrift.trajectory.layout.record import to_json


def problem_image(
    problem: Problem,
    record: dict[str, Any],
    *,
    method: dict[str, Any],
    every: int,
    run_id: str,
    plan: Sequence[float] = (),
    start: Stored | None = None,
) -> bytes:
    """The bytes of a file that holds everything but samples; see `kickdrift.trajectory.layout.names.header_image`."""
    with image(run_id) as file:
        own = new_run(file, new_counts(file), run_id=run_id, every=every, compress=False, plan=plan)
        add_method(own, method)
        group = file.create_group(PROBLEM)
        add_text(group, "source", problem.source)
        add_text(group, "record", to_json(record))
        group.create_dataset("y0", data=problem.y0, track_times=False)
        own.attrs["sha256"] = problem_hash(file)
        new_samples(file)
        checksums.new_group(file, 0, 1, ())
        checkpoints.new_table(file, start)
        file.flush()
        return bytes(file.id.get_file_image())


def problem_hash(file: h5py.File) -> str:
    """SHA-256, in hexadecimal digits, of everything that a file holds once for its run.

    In this order: the texts of ``problem/record``, ``problem/source``, ``method`` and ``versions`` of ``kickdrift``,
    with a zero byte after each; ``every`` and ``y0``, as little-endian float64.
    """
    own = file["kickdrift"]
    found = hashlib.sha256()
    for name in ("problem/record", "problem/source", "method", "versions"):
        found.update(hashed(own[name].asstr()[()]))
    found.update(hashed(own.attrs["every"]) + hashed(own["problem/y0"][()]))
    return found.hexdigest()
