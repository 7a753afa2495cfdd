"""Radial velocities of a star with one planet, beside the Keplerian model of radvel.

radvel (Fulton et al. 2018, doi:10.1088/1538-3873/aaaaa8) gives K [cos(omega + f) + e cos(omega)], with omega of the
star's orbit and positive velocities away from the observer. kickdrift's ``omega`` is of the planet's orbit about the
star, the observer is along +z, and the star's velocity has the same formula and sign. The planet has a mass, so K
follows from the masses; both have the same period, eccentricity and time of pericentre.
"""

import math
from collections.abc import Iterator
from importlib.util import find_spec

import numpy as np

import kickdrift as kd
from kickdrift.model.units.unit_systems import AU, YEAR
from kickdrift_validation.claim import Claim, at_most, main, not_run

ORBITS = ((0.0, 90.0, 0.0), (0.3, 63.0, 40.0), (0.85, 20.0, 250.0))  # e, inc, omega
DAY = 86400.0
MASS, A = 1e-3, 1.3


def claims(long: bool = False) -> Iterator[Claim]:
    """The largest difference over 200 times in four periods."""
    for e, inc, omega in ORBITS:
        text = f"e = {e}, inc = {inc}, omega = {omega}: radial velocity, m/s"
        if find_spec("radvel") is None:
            yield not_run(text, "at most 1e-09", "radvel", "pip install radvel")
            continue
        from radvel.kepler import rv_drive

        bodies = [{"name": "star", "mass": 1.0},
                  {"name": "b", "mass": MASS, "a": A, "e": e, "inc": inc, "omega": omega}]  # fmt: skip
        system = kd.System.from_elements(bodies)
        motion = math.sqrt(float(system.units.gravity or 0.0) * (1.0 + MASS) / A**3)  # radians a year
        times = np.linspace(0.0, 4.0 * 2.0 * math.pi / motion, 200)
        found = kd.analysis.radial_velocities(system, times, integrator="gauss-radau15")
        size = MASS / (1.0 + MASS) * motion * A * math.sin(math.radians(inc)) / math.sqrt(1.0 - e * e) * AU / YEAR
        days = YEAR / DAY
        wanted = rv_drive(times * days, [2.0 * math.pi / motion * days, 0.0, e, math.radians(omega), size],
                          use_c_kepler_solver=False)  # fmt: skip
        yield at_most(text, float(np.abs(found - wanted).max()), 1e-9, "radvel")


if __name__ == "__main__":
    main(claims, __doc__)
