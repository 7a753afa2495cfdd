"""Copper heated through melting and cooled at zero pressure, stage by stage, beside LAMMPS' ``fix npt``.

One protocol of stages: relax, 2 ps at 300 K, 12 ps from 300 to 2500 K, 6 ps at 2500 K, 12 ps back to 300 K. The baths
are Nose-Hoover chains and the barostat is that of Martyna, Tobias & Klein, in both programs. 256 atoms have the copper
of Zhou, Johnson & Wadley 2004 with its smooth end. Each program runs from the same velocities of several seeds. The
means of a stage are over the seeds, with their standard errors. Melting and freezing are chance events, so ramps
scatter most. A protocol that is stopped in a stage and resumed has the same bits.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import kickdrift as kd
from kickdrift.engines.job import Job
from kickdrift.engines.lammps import model_of
from kickdrift.engines.lammps_world import World
from kickdrift.integrators import INTEGRATORS
from kickdrift.integrators.options import Options
from kickdrift.statistics.regression import student
from kickdrift_validation.claim import Claim, claim, main, not_run
from kickdrift_validation.elastic_constants import GPA, copper

DT, EVERY = 0.002, 10  # ps, steps
TAU, BOX_TAU = 0.1, 0.5  # ps, of the baths and of the barostat
COLD, HOT = 300.0, 2500.0  # K
STAGES = {"cold": (COLD, COLD, 1000), "heat": (COLD, HOT, 6000), "melt": (HOT, HOT, 3000), "cool": (HOT, COLD, 6000)}
SEEDS = range(1, 7)
RARE = 0.0027  # chance of a larger difference by Student's distribution; three standard errors of many seeds
LAMMPS = "LAMMPS, fix npt iso"


def stages() -> list[kd.Stage]:
    """The protocol; nothing is kept but means."""
    shared = {
        "integrator": "nose-hoover", "dt": DT, "tau": TAU, "pressure": 0.0, "barostat": "mtk", "pressure_tau": BOX_TAU,
        "every": EVERY,
    }  # fmt: skip
    ramps = {
        name: {"temperature": low if low == high else {"from": low, "to": high}, "steps": steps}
        for name, (low, high, steps) in STAGES.items()
    }
    return [kd.Stage("relax", minimize=True), *(kd.Stage(name, **shared, **given) for name, given in ramps.items())]


def start(seed: int) -> kd.System:
    """Copper at twice the temperature, because half of the heat becomes potential energy."""
    return copper().at(3.615).with_velocities(temperature=2.0 * COLD, seed=seed)


def ours(seed: int) -> dict[str, tuple[float, float]]:
    """Mean volume and pressure (GPa) of each stage."""
    found = kd.run_stages(start(seed), stages())
    return {name: (found[name].volume, found[name].pressure / GPA) for name in STAGES}


def theirs(seed: int, world: World) -> dict[str, tuple[float, float]]:
    """The same by LAMMPS, whose k_B is 1 here."""
    system = start(seed)
    job = Job(system, INTEGRATORS["velocity-verlet"], "velocity-verlet", Options(dt=DT))
    world.reset(model_of(job, 1), system.state.positions, system.state.velocities)
    boltzmann, found = system.units.boltzmann, {}
    for name, (low, high, steps) in STAGES.items():
        world.lmp.commands_string(f"""
unfix move
fix move all npt temp {low * boltzmann!r} {high * boltzmann!r} {TAU!r} iso 0.0 0.0 {BOX_TAU!r} mtk yes
timestep {DT!r}
""")
        rows, first = [], int(world.lmp.extract_global("ntimestep"))
        for k in range(steps // EVERY + 1):  # a stage of kickdrift has a sample at its start, too
            length, again = (EVERY, "pre no ") if k > 1 else (EVERY * k, "")
            world.lmp.command(f"run {length} {again}post no start {first} stop {first + steps}")
            rows.append((world.lmp.get_thermo("vol"), world.lmp.get_thermo("press") / GPA))
        found[name] = tuple(np.mean(rows, axis=0).tolist())
    return found


def mean_of(values: list[float]) -> tuple[float, float]:
    """Mean and its standard error."""
    return float(np.mean(values)), float(np.std(values, ddof=1) / np.sqrt(len(values)))


def killed() -> bool:
    """Whether a protocol that stops in the middle of its ramp goes on with the same bits."""
    short = [
        kd.Stage("cold", **(dict(stages()[1].run) | {"steps": 60})),
        kd.Stage("heat", **(dict(stages()[2].run) | {"steps": 200})),
        kd.Stage("melt", **(dict(stages()[3].run) | {"steps": 60})),
    ]

    def stop(done: int, of: int) -> None:
        if of == 200 and done >= 90:
            raise KeyboardInterrupt

    with tempfile.TemporaryDirectory() as folder:
        whole, cut = Path(folder) / "whole.h5md", Path(folder) / "cut.h5md"
        kd.run_stages(start(1), short, output=whole)
        try:
            kd.run_stages(start(1), short, output=cut, progress=stop)
        except KeyboardInterrupt:
            kd.run_stages(cut.with_name("cut-heat.h5md"))
        ends = []
        for path in (whole, cut):
            with kd.open(path.with_name(f"{path.stem}-melt.h5md")) as run:
                ends.append(run[-1].positions.tobytes())
    return ends[0] == ends[1]


def claims(long: bool = False) -> Iterator[Claim]:
    """Volume and pressure of each stage beside LAMMPS; the bits of a protocol that was stopped."""
    same = killed()
    title = "a protocol stopped within its ramp and resumed"
    yield claim(title, "same bits" if same else "other bits", "same bits", same, "a protocol that never stopped")
    bound = f"Student's t with a chance above {RARE:g}"
    try:
        world = World()
    except ImportError:
        yield not_run("copper heated through melting", bound, LAMMPS)
        return
    seeds = SEEDS if long else SEEDS[:3]
    both = [*map(ours, seeds)], [theirs(seed, world) for seed in seeds]
    for name, (low, high, steps) in STAGES.items():
        for k, (what, unit, digits) in enumerate((("volume", "angstrom^3", 1), ("pressure", "GPa", 3))):
            (one, error), (other, their_error) = (mean_of([each[name][k] for each in found]) for found in both)
            chance = 2.0 * student(2 * len(seeds) - 2, -abs(one - other) / np.hypot(error, their_error))
            text = f"{one:.{digits}f}({error:.{digits}f}), LAMMPS {other:.{digits}f}({their_error:.{digits}f}) {unit}"
            title = f"{name}, {low:g} to {high:g} K in {steps * DT:g} ps: mean {what}"
            yield claim(title, text, bound, bool(chance > RARE), LAMMPS)


if __name__ == "__main__":
    main(claims, __doc__)
