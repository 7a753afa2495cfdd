# %% [markdown]
# # Choose an integrator
#
# No method is best for everything, so measure on your own system. `kd.compare` runs methods with several steps, and
# prints error against cost.

# %%
import numpy as np

import kickdrift as kd


def pendulum(t, y):
    return np.array([y[1], -np.sin(y[0])])


def energy(t, y):
    return 0.5 * y[1] ** 2 - np.cos(y[0])


# %% [markdown]
# `accuracy` is the error that you accept. The recommendation is the cheapest method and step that reach it.

# %%
found = kd.compare(
    pendulum, ["rk4", "dop853", "dormand-prince45"], y0=[1.0, 0.0], t_span=(0.0, 40.0), energy=energy, accuracy=1e-5
)
print(found)
best = found.recommendation.choice
if best is not None:
    print(best.method, best.dt, best.rtol)

# %% [markdown]
# A step also has a longest length beyond which a method is unstable, whatever the accuracy.

# %%
for name in ("rk4", "velocity-verlet", "yoshida4"):
    print(f"{name:16} {kd.integrator(name).stability}")

# %% [markdown]
# The figure shows the error against the work for each method.

# %%
found.plot()
