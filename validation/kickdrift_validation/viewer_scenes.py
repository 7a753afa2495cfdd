"""The runs that the script ``viewer`` looks at: a liquid, a mixture, planets, a collision and a leaning box."""

from pathlib import Path

import numpy as np

import kickdrift as kd

MARKUP = "<img src=x onerror=alert(1)></script><script>alert(2)</script>"


def leaning() -> kd.System:
    """A Lennard-Jones liquid in a box whose edges lean, from a lattice that leans alike."""
    box = kd.Box(matrix=[[7.4, 0, 0], [-3.0, 7.4, 0], [2.8, 2.4, 7.4]])
    parts = (np.indices((7, 7, 7)).reshape(3, -1).T + 0.5) / 7
    v = np.random.default_rng(4).normal(size=parts.shape)
    return kd.System(
        parts @ box.matrix, v - v.mean(axis=0), box=box, forces=[kd.LennardJones(cutoff=2.5)], name="leaning box"
    )


def colliding() -> kd.System:
    """Two planets that go round a star in opposite directions and meet, and one outside. The names hold markup."""
    x = [[0.0, 0, 0], [1.0, 0, 0], [-1.0, 0, 0], [0.0, -1.7, 0.2]]
    v = [[0.0, 0, 0], [0.0, 1.0, 0], [0.0, 1.0, 0], [0.77, 0, 0]]
    return kd.System(
        x, v, [1.0, 1e-3, 5e-4, 1e-3], forces=[kd.Gravity()], units="nbody", radii=[0.02, 0.05, 0.04, 0.05],
        names=["Star", "<b>b</b>", "c", "d"], events=[kd.Collision()], name=MARKUP,
    )  # fmt: skip


def mixed() -> kd.Simulation:
    """A mixture of two species in equilibrium."""
    sim = kd.Simulation(kd.load("lj-binary-1000"))
    sim.equilibrate(temperature=1.0, steps=400)
    return sim


def runs(folder: Path) -> dict[str, Path]:
    """Write the runs' files; return their paths by name."""
    plans = {
        "liquid": (kd.Simulation(kd.load("lj-1000")), {"steps": 1000, "every": 5}),
        "mixture": (mixed(), {"steps": 200, "every": 5}),
        "planets": (kd.Simulation(kd.load("solar-system")), {"steps": 2400, "every": 20}),
        "collision": (kd.Simulation(colliding(), "gauss-radau15"), {"until": 8.0, "interval": 0.02}),
        "leaning": (kd.Simulation(leaning(), dt=0.004), {"steps": 200, "every": 5}),
    }
    made = {}
    for name, (sim, plan) in plans.items():
        made[name] = folder / f"{name}.h5md"
        sim.run(**plan, output=made[name])  # type: ignore[arg-type]
    return made
