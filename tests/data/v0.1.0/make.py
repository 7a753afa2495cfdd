"""Make the run files of this folder. It ran once, with kickdrift 0.1.0: ``python make.py``.

Each case runs halfway into a file. Then the same run goes to its end without a file, and its last state is stored.
"""

from pathlib import Path

import numpy as np

import kickdrift as kd

HERE = Path(__file__).parent


def liquid(**options):
    """A small liquid of two species, 54 of A and 54 of B."""
    text = """
units = "lj"
[particles]
lattice = "fcc"
count = 108
density = 0.8
seed = 2
species = { A = 0.5, B = 0.5 }
[velocities]
temperature = 1.0
seed = 3
[box]
periodic = true
[[force]]
type = "lennard-jones"
cutoff = 2.3
truncation = "shift"
[force.species]
A = { epsilon = 1.0, sigma = 1.0 }
B = { epsilon = 0.5, sigma = 0.9 }
"""
    path = HERE / "liquid.toml"
    path.write_text(text)
    try:
        return kd.Simulation(kd.load(path), "velocity-verlet", dt=0.004, **options)
    finally:
        path.unlink()


def meeting():
    """Two balls that merge with a heavy ball, and one that passes."""
    x = [[0, 0, 0], [1.0, 0, 0], [4.0, 0, 0], [-1.2, -2.5, 0.3]]
    v = [[0, 0, 0], [-1.0, 0, 0], [-1.0, 0, 0], [-0.1, 1.0, 0]]
    system = kd.System(
        x, v, [1.0, 0.01, 0.02, 1e-3], forces=[kd.Gravity()], units="nbody", radii=0.1, names=list("abcd")
    )
    return kd.Simulation(
        system, "velocity-verlet", dt=0.01, events=[kd.Collision(action="merge"), kd.CloseApproach(1.5)]
    )


SMALL = kd.FileOptions(compress=True)
CASES = {
    "liquid": (lambda: liquid(), 40, 10, None),
    "liquid-mixed": (
        lambda: liquid(precision="mixed"), 40, 10,
        kd.FileOptions(precision="float32", write=("forces", "images"), compress=True),
    ),
    "planets": (lambda: kd.Simulation(kd.load("solar-system"), "wisdom-holman", dt=0.01), 50, 10, SMALL),
    "adaptive": (lambda: kd.Simulation(kd.load("sun-jupiter"), "gauss-radau15"), 30, 10, SMALL),
    "meeting": (meeting, 150, 25, SMALL),
}  # fmt: skip

if __name__ == "__main__":
    ends = {}
    for name, (make, steps, every, options) in CASES.items():
        sim = make()
        sim.run(steps, every=every, output=HERE / f"{name}.h5md", overwrite=True, file=options)
        sim.run(steps, every=every)
        ends[f"{name}/phase"] = sim.state.phase
        ends[f"{name}/energy"] = np.array(sim.energy().total)
    np.savez_compressed(HERE / "ends.npz", **ends)
