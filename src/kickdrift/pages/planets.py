"""The page of planets: the solar system by two methods, and planets that the reader adds."""

from typing import Any

from kickdrift.pages.module import Module
from kickdrift.pages.particles import page_system, run_of

SYSTEM = "solar-system"
METHODS = ("wisdom-holman", "velocity-verlet")
ADDED = {"a comet without mass": 0.0, "an Earth": 3.0035e-6, "a Jupiter": 9.546e-4, "ten Jupiters": 9.546e-3}  # in suns
MOST_ADDED = 3
PLACES = (7.0, 8.0, 13.0)  # AU, of the added planets' first orbits, which the page changes
ECLIPTIC = 23.4392911  # degrees between the planes of the Earth's equator and its orbit in 2000


def planets_runs(module: Module) -> dict[str, Any]:
    """The solar system, and the same with up to three more bodies of each mass; names are "method|count|mass"."""
    found = {}
    for count in range(MOST_ADDED + 1):
        for kind, mass in ADDED.items() if count else [("", 0.0)]:
            system = page_system(SYSTEM)
            for k, place in enumerate(PLACES[:count]):
                system = system.with_body(f"new {k + 1}", mass=mass, a=place)
            for name in METHODS:
                assert system.run.dt is not None
                found[f"{name}|{count}|{kind}"] = run_of(module, system, name, {"dt": system.run.dt})
    return found


def shown_planets() -> dict[str, Any]:
    """What the page knows beside the runs: names of the bodies, masses, and G."""
    system = page_system(SYSTEM)
    return {
        "names": list(system.names), "added": ADDED, "most": MOST_ADDED, "G": system.units.gravity,
        "methods": METHODS, "tilt": ECLIPTIC, "dt": system.run.dt,
    }  # fmt: skip
