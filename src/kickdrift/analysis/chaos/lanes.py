"""Growth of deviations in many small systems at once, for MEGNO."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from kickdrift.analysis.tangents.deviations import LARGEST, cadence, first_deviation, scale_of
from kickdrift.batch.members import common, members_of
from kickdrift.batch.sampling import run_lanes
from kickdrift.errors import InputError
from kickdrift.forces.gravity.batch import LOOK, measure_in_lanes
from kickdrift.integrators.stepping.batch_loops import Deviations, Members, from_lanes, to_lanes
from kickdrift.jit.lanes.memory import aligned
from kickdrift.jit.lanes.vectors import WIDTH
from kickdrift.model.state import Floats
from kickdrift.model.system import System


class Growths(NamedTuple):
    """Growth of each system's deviation over k looks."""

    integrator: str
    steps: int
    dt: Floats  # dt of each system (members,)
    times: Floats  # (members, k) since the start
    growth: Floats  # (members, k) ln of the deviation's length, 0 at the start
    begin: Floats  # (members, 3) kinetic, potential, total energy
    end: Floats  # (members, 3) the same at the end


@np.errstate(all="ignore")  # systems may blow up
def growths(
    systems: Sequence[System],
    lengths: Sequence[float],
    integrator: str | None,
    dt: Any,
    seeds: Sequence[int],
    options: dict[str, Any],
) -> Growths:
    """Run systems with deviations from these seeds for times ``lengths``."""
    name, method, own, steps_of = common(tuple(systems), integrator, dt, options)
    taken = [cadence(length, h) for length, h in zip(lengths, steps_of, strict=True)]
    (steps, every), n = taken[0], len(systems[0])
    for k, (mine, _) in enumerate(taken):
        if mine != steps:
            raise InputError(
                f"system {k}: all systems of a batch need the same steps; it has {mine}, system 0 has {steps}"
            )
    phase = np.array([system.state.phase for system in systems])
    accelerations, begin = _measured(members_of(systems, steps_of, phase))
    scale = scale_of(phase, accelerations)
    drawn = np.array([first_deviation(n, seed) for seed in seeds]) * scale
    members = members_of(systems, steps_of, np.concatenate([phase, drawn], axis=-1))
    stepper = method.in_lanes(members, own)
    counts = np.full(-(-steps // every), every, np.int64)
    counts[-1] = steps - (len(counts) - 1) * every
    watch = Deviations(to_lanes(1.0 / scale[..., 0, 0]), LARGEST)
    looks, exponents = run_lanes(stepper, counts, 0, watch)
    sizes, count = looks[:, 0, : len(systems)], len(systems)
    scaled = np.cumsum(exponents[:, :count], axis=0) - exponents[:, :count]  # before each look
    growth = np.concatenate([np.zeros((1, count)), np.log(sizes) + scaled * math.log(2.0)])
    passed = np.concatenate([[0], np.cumsum(counts)])
    start = from_lanes(members.start, count)[:, None]
    return Growths(
        integrator=name,
        steps=steps,
        dt=steps_of,
        times=(start + passed * steps_of[:, None]) - start,
        growth=np.ascontiguousarray(growth.T),
        begin=begin,
        end=_measured(members._replace(y=stepper.y))[1],
    )


def _measured(members: Members) -> tuple[Floats, Floats]:
    """Accelerations of the bodies (members, 3, n), and kinetic, potential and total energy (members, 3)."""
    blocks, n = len(members.y), members.gm.shape[1]
    a, found = aligned((blocks, *members.y.shape[2:])), aligned((blocks, LOOK, WIDTH))
    for block in range(blocks):
        measure_in_lanes(members.bodies(block), members.y[block], a[block], found[block])
    energies = from_lanes(found, len(members.systems))[:, :2]
    return from_lanes(a, len(members.systems))[..., :n], np.column_stack([energies, energies.sum(axis=1)])
