"""What hermite4 conserves and reaches, in shared and in block steps.

Plummer spheres in N-body units (Henon's: G = M = 1, E = -1/4), softened by 4 / n: the largest energy error over one
crossing time, 2 sqrt 2, against eta, and the cost of block steps over shared ones. Kepler's orbit of eccentricity 0.9
over one turn and ten, in closed form. Burrau's Pythagorean problem against states of 34 digits
(data/nbody/quad_states.json): two of its bodies come as near as 4e-4 at t = 15.8, and errors grow from meeting to
meeting.
"""

import json
import math
from time import perf_counter

import numpy as np

import kickdrift as kd
from kickdrift.model.starts.plummer import plummer
from kickdrift_validation.claim import Claim, claim, main
from kickdrift_validation.folders import DATA
from kickdrift_validation.problems import kepler

STATES = DATA / "nbody" / "quad_states.json"
SCHEMES = ("shared", "block")
ETAS = (0.08, 0.02, 0.005)
CROSSING = 2 * math.sqrt(2.0)
LOOKS = 20
SHORT, LONG = (256,), (256, 1024)  # stars
MASSES = np.array([0.6, 0.4])


def spheres(counts: tuple[int, ...], timed: bool) -> list[Claim]:
    rows = []
    print(f"{'stars':>6} {'scheme':7} {'eta':>6} {'points':>7} {'evaluations':>11} {'energy error':>12} {'seconds':>8}")
    for n in counts:
        x, v, masses = plummer(n, seed=1)
        system = kd.System(x, v, masses, forces=[kd.Gravity(softening=4.0 / n)], units="nbody", name=f"plummer-{n}")
        errors, seconds = {}, {}
        for scheme in SCHEMES:
            for eta in ETAS:
                sim = kd.Simulation(system, "hermite4", eta=eta, scheme=scheme)
                sim.run(1)  # compiled
                sim.state = system.state
                began = perf_counter()
                report = sim.run(until=CROSSING, interval=CROSSING / LOOKS)
                took = perf_counter() - began
                assert report.energy is not None
                errors[scheme, eta], seconds[scheme, eta] = report.energy.max_relative_error, took
                print(
                    f"{n:6} {scheme:7} {eta:6} {sim.steps_done:7} {report.force_evaluations:11} "
                    f"{report.energy.max_relative_error:12.1e} {took:8.2f}",
                    flush=True,
                )
        for scheme in SCHEMES:
            slope = math.log(errors[scheme, ETAS[0]] / errors[scheme, ETAS[-1]]) / math.log(ETAS[0] / ETAS[-1])
            text = f"{n} stars, {scheme}: power of eta in the energy error"
            rows.append(claim(text, slope, "1.6 or more", slope >= 1.6, "eta^2, as h^4"))
        worst = errors["block", 0.02]
        rows.append(claim(f"{n} stars, block, eta 0.02: energy error", worst, "below 1e-5", worst < 1e-5, "a crossing"))
        if timed:
            ratio = seconds["shared", 0.02] / seconds["block", 0.02]
            rows.append(claim(f"{n} stars: shared over block, time", ratio, "above 2", ratio > 2, "the same eta"))
    return rows


def ellipse() -> list[Claim]:
    """Kepler's orbit of e = 0.9, after one turn and ten.

    In a whole turn the energy errs as h^5 only, but the phase error that follows from it grows as the square of the
    turns: after ten it still outweighs the error as h^4 at the coarser steps, with the other sign."""

    def state(t: float) -> np.ndarray:
        return np.array(kepler(t, 0.9))[:, None, :] * np.array([-MASSES[1], MASSES[0]])[:, None]

    x, v = state(0.0)
    system = kd.System(x, v, masses=MASSES, forces=[kd.Gravity()], units="nbody")
    rows = []
    for scheme in SCHEMES:
        points, errors = [], []
        for eta in (2e-3, 5e-4, 1.25e-4):
            sim = kd.Simulation(system, "hermite4", eta=eta, scheme=scheme)
            for turns in (1, 10):
                report = sim.run(until=turns * 2 * math.pi)
                found = np.array([sim.state.positions, sim.state.velocities])
                error = np.abs(found - state(turns * 2 * math.pi)).max()
                if turns == 1:
                    points.append(sim.steps_done)
                    errors.append(error)
                assert report.energy is not None
                energy = abs(report.energy.final / report.energy.initial - 1)
                print(
                    f"e = 0.9, {scheme:7} eta {eta:8}, {turns:2} turns: {sim.steps_done:6} points, "
                    f"error {error:.1e}, energy {energy:.1e}"
                )
        slope = -math.log(errors[-1] / errors[0]) / math.log(points[-1] / points[0])
        text = f"Kepler, e = 0.9, {scheme}: order after a turn"
        rows.append(claim(text, slope, "4 within 0.15", abs(slope - 4) < 0.15, "closed form"))
    return rows


def pythagorean() -> list[Claim]:
    """Burrau 1913; Szebehely & Peters 1967, doi:10.1086/110355."""
    case = json.loads(STATES.read_text(encoding="utf-8"))["pythagorean_burrau"]
    start = np.array(case["initial_state"], dtype=float).reshape(3, 6)
    states = np.array(case["reference_states_quad"], dtype=float).reshape(-1, 3, 6)
    system = kd.System(start[:, :3], start[:, 3:], masses=[3, 4, 5], forces=[kd.Gravity(G=1.0)], units="nbody")
    rows = []
    for scheme in SCHEMES:
        for eta in (0.02, 1e-3, 5e-5):
            sim = kd.Simulation(system, "hermite4", eta=eta, scheme=scheme)
            errors = []
            for time, state in zip(case["times"], states, strict=True):
                report = sim.run(until=float(time))
                errors.append(float(np.abs(sim.state.positions - state[:, :3]).max()))
            assert report.energy is not None
            shown = " ".join(f"{error:.0e}" for error in errors)
            print(f"pythagorean, {scheme:7} eta {eta:6}: {sim.steps_done:7} points, errors at 10, 20, … 80: {shown}")
        text = f"pythagorean, {scheme}, eta 5e-5: error at t = 40"
        rows.append(claim(text, errors[3], "below 1e-3", errors[3] < 1e-3, "34 digits"))
    return rows


def claims(long: bool = False) -> list[Claim]:
    """The larger cluster and what depends on the clock in the long set only."""
    return [*spheres(LONG if long else SHORT, timed=long), *ellipse(), *pythagorean()]


if __name__ == "__main__":
    main(claims, __doc__)
