"""leapfrog-adaptive on Kepler's orbits: its order, the way back, and whether its energy stays where it was.

Two bodies, e = 0.3 and 0.9, against the closed form half a turn later: the slope of the error over the number of steps.
Then as many steps back as ahead, after the velocities are negated. Last the largest energy error of the last tenth of
many turns over that of the first: a reversible method whose steps follow the motion has no drift on such an orbit
(Hairer, Lubich & Wanner 2006, XI.3, doi:10.1007/3-540-30666-8).
"""

import math
from collections.abc import Iterator

import numpy as np

import kickdrift as kd
from kickdrift_validation.claim import Claim, at_most, claim, main, under
from kickdrift_validation.measures import reversal_error
from kickdrift_validation.problems import kepler

NAME = "leapfrog-adaptive"
MASSES = np.array([0.6, 0.4])
STEPS, WITHIN = 2000, 0.1
SHORT, LONG = 200, 5000  # turns
COMES_BACK, BOUNDED = 1e-10, 1.1


def two_bodies(e: float, t: float = 0.0) -> kd.System:
    """At a time after pericentre; G = 1, semi-major axis 1."""
    shares = np.array([-MASSES[1], MASSES[0]])[:, None]
    r, v = kepler(t, e)
    return kd.System(shares * r, shares * v, masses=MASSES, forces=[kd.Gravity()], units="nbody")


def order(e: float) -> Claim:
    steps, errors = [], []
    for dt in 0.02 * (1 - e) ** 1.5 / 2.0 ** np.arange(4):
        sim = kd.Simulation(two_bodies(e), NAME, dt=dt)
        sim.run(until=math.pi, every=2**40)
        steps.append(sim.steps_done)
        errors.append(float(np.linalg.norm(sim.state.phase - two_bodies(e, math.pi).state.phase)))
    slope = -float(np.polyfit(np.log(steps), np.log(errors), 1)[0])
    text = f"{NAME}, e = {e:g}: slope of the error over the number of steps"
    return claim(text, slope, f"2 within {WITHIN:g}", abs(slope - 2) <= WITHIN, "closed form")


def energy(e: float, turns: int) -> Claim:
    sim = kd.Simulation(two_bodies(e), NAME, dt=0.01 * (1 - e) ** 1.5)
    sim.run(until=turns * 2 * math.pi, interval=2 * math.pi / 16.18)
    total = np.array([sample.energies.total for sample in sim.record.samples])
    parts = np.array_split(np.abs(total[1:] / total[0] - 1.0), 10)
    text = f"{NAME}, e = {e:g}: largest energy error of the last tenth of {turns} turns over that of the first"
    return at_most(text, float(parts[-1].max() / parts[0].max()), BOUNDED, "Hairer, Lubich & Wanner 2006, XI.3")


def claims(long: bool = False) -> Iterator[Claim]:
    for e in (0.3, 0.9):
        yield order(e)
        left = reversal_error(NAME, two_bodies(e), 0.01 * (1 - e) ** 1.5, STEPS)
        yield under(f"{NAME}, e = {e:g}: {STEPS} steps there and back leave", left, COMES_BACK, "the start")
        yield energy(e, LONG if long else SHORT)


if __name__ == "__main__":
    main(claims, __doc__)
