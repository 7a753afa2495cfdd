# %% [markdown]
# # The solar system
#
# `solar-system` holds the Sun, eight planets and Pluto from JPL's ephemeris. A Wisdom-Holman map follows them with
# steps of two days.

# %%
import matplotlib.pyplot as plt
import numpy as np

import kickdrift as kd

system = kd.load("solar-system")
print(system)

# %% [markdown]
# A thousand years take seconds. The report says how well energy and angular momentum are kept.

# %%
sim = kd.Simulation(system, "wisdom-holman", dt=0.005)
report = sim.run(until=1000.0, every=400, output="planets.h5md", overwrite=True)
print(report.energy.max_relative_error, report.energy.verdict)

# %% [markdown]
# The planets pull at each other, so their ellipses change slowly. The file gives the elements over time.

# %%
with kd.open("planets.h5md") as run:
    table = kd.analysis.orbital_elements(run, "heliocentric", "invariable")
    x = run[:250].positions - run[:250].positions[:, :1]
names = list(dict.fromkeys(table["body"]))
for name in names:
    e = table["e"][table["body"] == name]
    print(f"{name:12} e from {e.min():.4f} to {e.max():.4f}")

# %%
figure, (left, right) = plt.subplots(1, 2, figsize=(11.5, 4.6), layout="constrained")
for k, name in enumerate(names):
    left.plot(x[:, k + 1, 0], x[:, k + 1, 1], ".", markersize=1.5, label=name)
    rows = table["body"] == name
    right.plot(table["time"][rows], table["e"][rows], linewidth=0.9, label=name)
left.set(title="500 years of orbits", xlabel="x (AU)", ylabel="y (AU)", aspect="equal")
right.set(title="Eccentricities", xlabel="time (years)", ylim=(0, 0.27))
right.legend(fontsize=7, ncols=2, loc="center", bbox_to_anchor=(0.5, 0.6))
figure.suptitle(f"Energy kept to {report.energy.max_relative_error:.1e}")
assert np.isfinite(x).all()
plt.show()
