"""Draw docs/assets/two-worlds.png, the picture of the front page: a liquid, and planets with asteroids.

    python docs/front_page.py [--output docs/assets/two-worlds.png] [--overwrite]

The spheres are coloured by speed, the asteroids by eccentricity. The planets' lines are their last revolution.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import matplotlib
import numpy as np

import kickdrift as kd
from kickdrift.plots.drawing import COLOURS, INK, checked_target, new_axes, new_figure, save_figure

PIXELS = 900  # of each side of the liquid's picture
LIGHT = np.array([-0.45, 0.55, 0.70])  # direction of the light, from the scene
RADIUS = 0.5  # of a sphere, in sigma
ASTEROIDS = 1000
OBLIQUITY = np.radians(23.4392911)  # of the ecliptic to the equator, whose axes the system's file uses
ECLIPTIC = np.array([[1, 0, 0], [0, np.cos(OBLIQUITY), np.sin(OBLIQUITY)], [0, -np.sin(OBLIQUITY), np.cos(OBLIQUITY)]])


def turned(x: np.ndarray) -> np.ndarray:
    """Positions (n, 3) as a viewer sees them who looks at the box's corner from above."""
    a, b = np.radians(38.0), np.radians(24.0)
    about_z = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])
    about_x = np.array([[1, 0, 0], [0, np.sin(b), np.cos(b)], [0, -np.cos(b), np.sin(b)]])
    return x @ (about_x @ about_z).T


def liquid() -> np.ndarray:
    """Picture (PIXELS, PIXELS, 4) of lj-1000 as a liquid: shaded spheres, the nearest in front."""
    sim = kd.Simulation(kd.load("lj-1000"), dt=0.005)
    sim.equilibrate(temperature=1.0, time=5.0)
    state = sim.state
    lengths = np.diag(np.asarray(state.box.matrix))
    x = turned(np.mod(state.positions, lengths) - lengths / 2)
    speeds = np.linalg.norm(state.velocities, axis=1)
    colours = matplotlib.colormaps["viridis"](np.clip(speeds / 3.2, 0, 1))[:, :3]
    half = 1.02 * np.abs(x[:, :2]).max() + RADIUS
    scale = PIXELS / (2 * half)
    picture, depth = np.zeros((PIXELS, PIXELS, 4)), np.full((PIXELS, PIXELS), -np.inf)
    near, far = x[:, 2].max(), x[:, 2].min()
    light = LIGHT / np.linalg.norm(LIGHT)
    for (cx, cy, cz), colour in zip(x, colours, strict=True):
        left, low = (np.floor((np.array([cx, cy]) - RADIUS + half) * scale)).astype(int)
        size = int(2 * RADIUS * scale) + 3
        columns, rows = np.arange(left, left + size), np.arange(low, low + size)
        dx = (columns + 0.5) / scale - half - cx
        dy = (rows + 0.5) / scale - half - cy
        height2 = RADIUS**2 - dx[None, :] ** 2 - dy[:, None] ** 2
        height = np.sqrt(np.maximum(height2, 0.0))
        place = np.ix_(PIXELS - 1 - rows, columns)
        seen = (height2 > 0) & (cz + height > depth[place])
        normal_light = (dx[None, :] * light[0] + dy[:, None] * light[1] + height * light[2]) / RADIUS
        bright = 0.30 + 0.70 * np.maximum(normal_light, 0.0)
        shine = 0.35 * np.maximum(normal_light, 0.0) ** 30
        haze = 0.35 * (near - cz) / (near - far)  # what is far away is paler
        shaded = np.minimum(colour * bright[:, :, None] + shine[:, :, None], 1.0) * (1 - haze) + haze
        picture[place] = np.where(seen[:, :, None], np.dstack([shaded, np.ones_like(height)]), picture[place])
        depth[place] = np.where(seen, cz + height, depth[place])
    return picture


def asteroids() -> kd.System:
    """The Sun, Mars, Jupiter and massless asteroids between 1.9 and 3.7 AU."""
    planets = kd.load("solar-system")
    chosen = [planets.names.index(name) for name in ("Sun", "Mars", "Jupiter")]
    state, random = planets.state, np.random.default_rng(1)
    sun_x, sun_v = state.positions[chosen[0]], state.velocities[chosen[0]]
    a = random.uniform(1.9, 3.7, ASTEROIDS)
    angle = random.uniform(0, 2 * np.pi, ASTEROIDS)
    along = np.stack([np.cos(angle), np.sin(angle), np.zeros(ASTEROIDS)], axis=1)
    across = np.stack([-np.sin(angle), np.cos(angle), np.zeros(ASTEROIDS)], axis=1)
    speed = np.sqrt(planets.units.gravity / a) * random.normal(1.0, 0.04, ASTEROIDS)
    return kd.System(
        np.concatenate([state.positions[chosen], sun_x + a[:, None] * along @ ECLIPTIC]),
        np.concatenate([state.velocities[chosen], sun_v + speed[:, None] * across @ ECLIPTIC]),
        np.concatenate([state.masses[chosen], np.zeros(ASTEROIDS)]),
        forces=[kd.Gravity()], units=planets.units,
        names=["Sun", "Mars", "Jupiter", *(f"asteroid {k}" for k in range(ASTEROIDS))],
    )  # fmt: skip


def draw(target: Path) -> Path:
    """Both worlds side by side."""
    figure = new_figure(10.0, 4.9)
    left, right = new_axes(figure, (1, 2, 1)), new_axes(figure, (1, 2, 2))
    left.imshow(liquid(), interpolation="antialiased")
    left.set_title("1000 Lennard-Jones particles, coloured by speed", fontsize=11, color=INK)

    system = asteroids()
    sim = kd.Simulation(system, "wisdom-holman", dt=0.02)
    sim.run(until=300.0)
    paths: list[np.ndarray] = []
    sim.run(time=11.9, every=2, observe=lambda s: paths.append(s.state.positions[:3].copy()))
    lines = np.array(paths)
    lines = (lines - lines[:, :1]) @ ECLIPTIC.T
    state = sim.state
    x, v = state.positions[3:] - state.positions[0], state.velocities[3:] - state.velocities[0]
    mu, r = system.units.gravity * state.masses[0], np.linalg.norm(x, axis=1)
    e = ((np.sum(v * v, axis=1) - mu / r)[:, None] * x - np.sum(x * v, axis=1)[:, None] * v) / mu
    x = x @ ECLIPTIC.T
    points = right.scatter(x[:, 0], x[:, 1], s=4, c=np.linalg.norm(e, axis=1), cmap="viridis", vmin=0, vmax=0.3)
    for k, name in ((1, "Mars"), (2, "Jupiter")):
        right.plot(lines[:, k, 0], lines[:, k, 1], color=COLOURS[k], linewidth=1.0)
        right.plot(*lines[-1, k, :2], "o", color=COLOURS[k], markersize=6)
        right.annotate(name, lines[-1, k, :2], (6, 6), textcoords="offset points", fontsize=9, color=INK)
    right.plot(0, 0, "*", color="#e69f00", markersize=13)
    right.set_aspect("equal")
    right.set_xlim(-5.7, 5.7)
    right.set_ylim(-5.7, 5.7)
    right.set_title("Asteroids after 300 years, coloured by eccentricity", fontsize=11, color=INK)
    figure.colorbar(points, ax=right, shrink=0.8, label="eccentricity")
    for axes in (left, right):
        axes.set_axis_off()
    return save_figure(figure, target)


def main() -> int:
    """Draw the picture."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path(__file__).parent / "assets" / "two-worlds.png")
    parser.add_argument("--overwrite", action="store_true")
    given = parser.parse_args()
    print(draw(checked_target(given.output, given.overwrite)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
