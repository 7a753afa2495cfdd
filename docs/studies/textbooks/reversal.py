"""On the way back: is leapfrog exactly reversible?

A run, its velocities negated, as many steps more: what differs from the start. In exact arithmetic, with the registry's
weights in rational numbers, nothing may; in floats rounding differs, and chaos multiplies it; whole numbers differ in
no bit (Levesque & Verlet 1993, doi:10.1007/BF01048022).
"""

from fractions import Fraction

import numpy as np

import kickdrift as kd
from docs.studies.textbooks.article import Claim, Reading, article
from kickdrift.integrators import integrator
from kickdrift.integrators.exact.stepper import Lattice
from kickdrift.integrators.splitting.method import Splitting
from kickdrift.odes import kepler
from kickdrift_validation.measures import reversal_error

STEPS, MELT_STEPS = 100_000, 3_000
RATIONAL_STEPS = 5  # digits double in each
EPSILON = float(np.finfo(float).eps)
EXACTLY = "time symmetry, Hairer, Lubich & Wanner 2006, V.1"


def pull(x: Fraction, z: Fraction) -> tuple[Fraction, Fraction]:
    return -x - 2 * x * z, -z - x * x + z * z


def rational(name: str, dt: Fraction, steps: int) -> int:
    """How many of four rational numbers differ from the start after the way there and back."""
    method = integrator(name)
    assert isinstance(method, Splitting)
    kicks, drifts = ([Fraction(w).limit_denominator(1000) for w in weights] for weights in (method.kick, method.drift))
    x, z, vx, vz = start = tuple(Fraction(n, 10) for n in (0, 1, 5, 0))
    for _ in range(2):
        for _ in range(steps):
            for k, kick in enumerate(kicks):
                ax, az = pull(x, z)
                vx, vz = vx + kick * dt * ax, vz + kick * dt * az
                if k < len(drifts):
                    x, z = x + drifts[k] * dt * vx, z + drifts[k] * dt * vz
        vx, vz = -vx, -vz
    return sum(a != b for a, b in zip((x, z, vx, vz), start, strict=True))


def whole_numbers(steps: int) -> int:
    """How many whole numbers differ, of leapfrog-exact on lj-1000."""
    sim = kd.Simulation(kd.load("lj-1000"), "leapfrog-exact", dt=0.005)
    first = sim.method_state
    sim.run(steps, every=steps)
    sim.method_state = sim.method_state.reversed()
    sim.run(steps, every=steps)
    back = sim.method_state.reversed()
    keys: tuple[str, ...] = Lattice._fields[:3]
    return sum(int((getattr(first, key) != getattr(back, key)).sum()) for key in keys)


def zero(text: str, differ: int, unit: str) -> Reading:
    return Reading(text, differ, differ == 0, "0", differ == 0, EXACTLY, unit)


def floats() -> list[Reading]:
    """Readings of velocity Verlet in float64."""
    orbit = reversal_error("velocity-verlet", kepler(0.5), 0.01, STEPS, careful=False)
    # What rounding makes of the energy shifts the phase for the rest of both ways: n^(3/2) eps dt after n steps.
    bound = 10 * EPSILON * (2 * STEPS) ** 1.5 * 0.01
    melt = reversal_error("velocity-verlet", kd.load("lj-1000"), 0.005, MELT_STEPS, careful=False)
    return [
        Reading(
            f"float64, Kepler e = 0.5, {STEPS} steps", orbit, orbit == 0, f"above 0, at most {bound:.1e}",
            0 < orbit <= bound, "10 eps n^(3/2) dt over both ways, Brouwer 1937, doi:10.1086/105423", "off",
        ),
        Reading(
            f"float64, 1000 LJ particles, {MELT_STEPS} steps", melt, melt == 0, "above 1e6 eps: chaos",
            melt > 1e6 * EPSILON, "positive Lyapunov exponent of a liquid", "off",
        ),
    ]  # fmt: skip


def claims(long: bool = False) -> list[Claim]:
    """kickdrift_validation.exact_reversal goes a million steps and through another process."""
    rationals = rational("velocity-verlet", Fraction(1, 10), RATIONAL_STEPS)
    return article(
        "leapfrog is exactly reversible",
        "The map is, and its arithmetic is not: floats round differently on the way back, and in a liquid that grows "
        "until nothing is left of the start. leapfrog-exact rounds every increment to whole numbers and comes back.",
        zero(f"rational numbers, {RATIONAL_STEPS} steps", rationals, "of 4 differ"),
        *floats(),
        zero(f"leapfrog-exact, 1000 LJ particles, {MELT_STEPS} steps", whole_numbers(MELT_STEPS), "of 9000 differ"),
    )
