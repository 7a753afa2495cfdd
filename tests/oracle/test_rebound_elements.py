"""Elements of orbits against rebound: in both directions, about the central body, in Jacobi coordinates, and of a
moon."""

from __future__ import annotations

import math

import numpy as np
import pytest

import kickdrift as kd

rebound = pytest.importorskip("rebound")

BODIES = [
    {"name": "star", "mass": 0.9},
    {"name": "b", "mass": 1e-3, "a": 1.0, "e": 0.1, "inc": 4.0, "Omega": 30.0, "omega": 60.0, "f": 10.0},
    {"name": "c", "mass": 3e-4, "a": 2.3, "e": 0.45, "inc": 20.0, "Omega": 200.0, "omega": 310.0, "M": 250.0},
    {"name": "fast", "mass": 1e-6, "a": -4.0, "e": 1.7, "inc": 100.0, "Omega": 5.0, "omega": 15.0, "f": -60.0},
]
ANGLES = ("inc", "Omega", "omega", "f", "M")


def theirs(frame: str) -> rebound.Simulation:
    """rebound's Simulation with these elements."""
    sim = rebound.Simulation()
    for k, body in enumerate(BODIES):
        given = {key: math.radians(value) if key in ANGLES else value for key, value in body.items()}
        mass, given["m"] = given.pop("mass"), body["mass"]
        if k and frame == "heliocentric":
            given["primary"] = sim.particles[0]
        del given["name"]
        sim.add(**given)
        assert mass == sim.particles[k].m
    sim.move_to_com()
    return sim


@pytest.mark.parametrize("frame", ["heliocentric", "jacobi"])
def test_both_programs_agree_on_states_and_elements(frame):
    system, sim = kd.System.from_elements(BODIES, units="nbody", frame=frame), theirs(frame)
    x = np.array([p.xyz for p in sim.particles])
    v = np.array([p.vxyz for p in sim.particles])
    np.testing.assert_allclose(system.state.positions, x, rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(system.state.velocities, v, rtol=1e-12, atol=1e-13)
    table = kd.Simulation(system, dt=0.01).elements(frame)
    primary = {"primary": sim.particles[0]} if frame == "heliocentric" else {}
    orbits = [p.orbit(**primary) for p in sim.particles[1:]]
    assert (table.names, table.central, len(table)) == (("b", "c", "fast"), "star", 3)
    for name, orbit in zip(table, orbits, strict=True):
        mine = table[name]
        for key in ("a", "e", "inc", "Omega", "omega", "f", "M"):
            expected = math.degrees(getattr(orbit, key)) if key in ANGLES else getattr(orbit, key)
            difference = getattr(mine, key) - expected
            if key in ANGLES:  # rebound's M is in [0, 2 pi), also on a hyperbola
                difference = (difference + 180.0) % 360.0 - 180.0
            assert abs(difference) < 1e-9 * max(1.0, abs(expected)), (name, key)
        assert (pytest.approx(orbit.P, rel=1e-10) if mine.e < 1 else math.inf) == mine.P
        assert mine.q == pytest.approx(orbit.a * (1 - orbit.e), rel=1e-10)
    given = np.array([(body["a"], body["e"], body["inc"]) for body in BODIES[1:]])
    np.testing.assert_allclose(np.column_stack([table.a, table.e, table.inc]), given, rtol=1e-10)


def test_a_moon_about_its_planet():
    moon = {"m": 1e-7, "a": 0.003, "e": 0.05, "inc": 0.4, "f": 1.1}
    sim = theirs("heliocentric")
    sim.add(primary=sim.particles[1], **moon)
    system = kd.System.from_elements(BODIES, units="nbody").with_body(
        "moon", mass=1e-7, primary="b", a=0.003, e=0.05, inc=math.degrees(0.4), f=math.degrees(1.1)
    )
    mine, them = system["moon"], sim.particles[4]
    apart = np.subtract(them.xyz, sim.particles[1].xyz)
    np.testing.assert_allclose(mine.position - system["b"].position, apart, rtol=1e-11)
    np.testing.assert_allclose(mine.velocity, them.vxyz, rtol=1e-11)
    assert mine.elements("b").a == pytest.approx(them.orbit(primary=sim.particles[1]).a, rel=1e-11)
