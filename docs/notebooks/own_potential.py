# %% [markdown]
# # Bring your own potential
#
# A pair law is one formula: energy and force of a squared distance. kickdrift compiles the formula and gives it every
# truncation, neighbour lists, threads and pressures.

# %%
import math
from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np

import kickdrift as kd

# %% [markdown]
# Morse's potential binds two atoms. `law(p, r2)` returns the energy, and the force over the distance.


# %%
@kd.pair_law
class Morse(NamedTuple):
    """U(r) = depth (e^(-2 w (r - b)) - 2 e^(-w (r - b))); Morse 1929, doi:10.1103/PhysRev.34.57."""

    depth: float = 1.0
    width: float = 6.0
    bond: float = 1.1

    def law(p, r2):
        r = math.sqrt(r2)
        e = math.exp(-p.width * (r - p.bond))
        return p.depth * (e * e - 2 * e), 2 * p.depth * p.width * (e * e - e) / r


# %% [markdown]
# kickdrift checks the slope of the energy against the force. `certify` runs more tests of a whole system, and names
# what fails.

# %%
start = kd.load("lj-1000").state
crystal = kd.System(
    start.positions, start.velocities, box=start.box, forces=[Morse(cutoff=2.5, truncation="force-shift")]
)
sim = kd.Simulation(crystal, dt=0.002)
sim.equilibrate(temperature=0.5, time=1.0)
report = sim.run(2000, every=10, output="morse.h5md", overwrite=True)
print(report.energy.rms_relative_error, report.energy.verdict, report.momentum_error)

# %%
with kd.open("morse.h5md") as run:
    rdf = kd.analysis.radial_distribution(run[::10], r_max=3.0)
r = np.linspace(0.85, 2.5, 300)
energy = np.array([Morse.Parameters().law(x * x)[0] for x in r])
figure, (left, right) = plt.subplots(1, 2, figsize=(10, 3.8), layout="constrained")
left.plot(r, energy, label="Morse")
left.plot(r, 4 * (r**-12 - r**-6), "--", label="Lennard-Jones")
left.set(title="Potential", xlabel="r", ylabel="U(r)", ylim=(-1.2, 2))
left.legend()
right.plot(rdf.r, rdf.g)
right.set(title="The liquid that Morse makes", xlabel="r", ylabel="g(r)")
plt.show()
