"""Deviation vectors for MEGNO: their start, their scale, and the cadence of samples."""

import numpy as np

from kickdrift.model.checks.limits import steps_in
from kickdrift.model.state import Floats

LOOKS = 10_000  # most samples of the deviation in a run of fixed steps
LARGEST = 2.0**200  # growth or decay of a deviation before it is scaled back
LARGEST_OF_PROBLEM = 2.0**10  # the same, where an absolute tolerance would lose a smaller one


def scale_of(phase: Floats, accelerations: Floats) -> Floats:
    """Distance and speed (…, 2, 1, 1) that scale deviations of particles at phase (…, 2, 3, n).

    The distance is the scatter of positions about their mean. The speed combines the scatter of velocities with the
    speed that the forces give over this distance. A scaled deviation has the same length in any units.
    """
    scatter = _rms(phase - phase.mean(axis=-1, keepdims=True))
    distance = _or(_or(scatter[..., 0], _rms(phase[..., 0, :, :])), 1.0)
    speed = _or(np.sqrt(scatter[..., 1] ** 2 + distance * _rms(accelerations)), 1.0)
    return np.stack([distance, speed], axis=-1)[..., None, None]


def _or(value: Floats, other: Floats | float) -> Floats:
    return np.where(value == 0.0, other, value)


def _rms(vectors: Floats) -> Floats:
    """Root mean square of the lengths of vectors (…, 3, n)."""
    return np.sqrt((vectors**2).sum(axis=-2).mean(axis=-1))


def first_deviation(n: int, seed: int) -> Floats:
    """Deviation (2, 3, n) of length 1 in a random direction."""
    drawn = np.random.Generator(np.random.PCG64(seed)).standard_normal((2, 3, n))
    return drawn / np.linalg.norm(drawn)


def direction(n: int, seed: int) -> Floats:
    """Deviation (n,) of length 1 in a random direction."""
    drawn = np.random.Generator(np.random.PCG64(seed)).standard_normal(n)
    return drawn / np.linalg.norm(drawn)


def cadence(length: float, dt: float) -> tuple[int, int]:
    """Number of steps, and number of steps between samples."""
    steps = max(1, round(steps_in("time", length, dt)))
    return steps, max(1, steps // LOOKS)
