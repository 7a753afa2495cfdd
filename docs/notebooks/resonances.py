# %% [markdown]
# # Resonances and secular frequencies
#
# Over thousands of years the ellipses of planets turn, and this motion is a sum of a few frequencies. Where periods
# form a ratio of whole numbers, an angle may librate: Neptune and Pluto are locked in 3 : 2.

# %%
import kickdrift as kd

sim = kd.Simulation(kd.load("outer-solar-system"), "wisdom-holman", dt=0.35)
report = sim.run(until=60_000.0, every=100, output="outer.h5md", overwrite=True)
print(report.energy.max_relative_error)

# %% [markdown]
# `orbit_report` finds the frequencies and the angles that librate, with their centres and amplitudes.

# %%
found = kd.analysis.orbit_report("outer.h5md")
print(found)

# %% [markdown]
# The picture shows the strongest lines of each orbit, and the angle of the resonance that swings and never turns.

# %%
found.plot()
