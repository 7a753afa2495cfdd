"""Differential equations against SciPy and against the end values of the IVP test set.

Not stiff: every problem of `kickdrift.odes` at 40 times, beside SciPy's DOP853 at rtol = 1e-13. How far a solver at
rtol = 1e-10 may be off depends on the problem, so SciPy's own DOP853 at the same tolerance is the measure. Arenstorf's
orbit and the Pleiades also at the states in binary128 and the end values of the test set.

Stiff: HIRES, OREGO, ROBER and VDPOL (mu = 1000) at the end values of the Test Set for IVP Solvers (Mazzia & Magherini
2008, Bari), with every stiff method that chooses its steps. bdf, radau and lsoda are SciPy's steps inside of our loop,
so that SciPy's own error is the measure too; they differ by the last step, which solve_ivp shortens and we take anew.
Backward Euler is not accurate enough to be held against such values; its error must halve with the step, on ROBER to
t = 40. --long adds the 11 decades of ROBER.
"""

import json
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

import kickdrift as kd
from kickdrift.odes import ODES
from kickdrift_validation.claim import Claim, at_most, claim, main
from kickdrift_validation.folders import DATA

LOOKS = 40
TIGHT, TOLERANCE = 1e-13, 1e-10
BESIDE = 10.0  # times SciPy's error at the same tolerance; the controllers differ, and an error may pass through zero
FLOOR = 1e-12  # what the reference itself may be off
LENGTHS: dict[str, tuple[dict[str, float], float]] = {  # parameters, and the time to go to
    "harmonic-oscillator": ({}, 20.0),
    "pendulum": ({}, 20.0),
    "kepler": ({"eccentricity": 0.5}, 20.0),
    "logistic": ({}, 20.0),
    "lotka-volterra": ({}, 20.0),
    "van-der-pol": ({"mu": 5.0}, 20.0),
    "arenstorf": ({}, 17.0),
    "pleiades": ({}, 3.0),
    "lorenz": ({}, 10.0),
}
STIFF = {  # the test set's name, and the smallest absolute tolerance in need
    "hires": ("hires", 1e-12), "orego": ("orego", 1e-8), "robertson": ("rober", 1e-20), "van-der-pol": ("vdpol", 1e-12),
}  # fmt: skip
METHODS = {"radau": "Radau", "bdf": "BDF", "lsoda": "LSODA", "rosenbrock": None}  # SciPy's names
RTOL = 1e-7
GLOBAL = 1000.0  # times rtol at the end of some thousand steps, each of which may be off by it
TEST_SET = "Test Set for IVP Solvers (Mazzia & Magherini 2008)"


def reference(folder: str, file: str) -> dict[str, Any]:
    return json.loads((DATA / folder / f"{file}.json").read_text(encoding="utf-8"))


def scipys(problem: kd.Problem, times: np.ndarray, method: str, rtol: float, atol: float) -> np.ndarray:
    """(times, dimensions), by solve_ivp."""
    given = {} if method.startswith("DOP") or problem.jacobian is None else {"jac": problem.jacobian}
    span = (problem.t0, float(times[-1]))
    found = solve_ivp(problem.f, span, problem.y0, method, times, rtol=rtol, atol=atol, **given)
    if not found.success:
        raise ArithmeticError(f"SciPy's {method} on {problem.name}: {found.message}")
    return found.y.T


def ours(problem: kd.Problem, times: np.ndarray, method: str, rtol: float, atol: float) -> np.ndarray:
    sim, found = kd.Simulation(problem, method, rtol=rtol, atol=atol), []
    for time in times:
        sim.run(until=float(time), every=2**40)
        found.append(np.array(sim.state.y))
    return np.array(found)


def dense() -> list[Claim]:
    """Every problem that is not stiff."""
    rows = []
    for name, (parameters, length) in LENGTHS.items():
        problem, times = ODES[name](**parameters), np.linspace(0.0, length, LOOKS + 1)[1:]
        exact = scipys(problem, times, "DOP853", TIGHT, TIGHT)
        scale = np.abs(exact).max(axis=0)
        us, them = (
            float((np.abs(run(problem, times, method, TOLERANCE, TOLERANCE) - exact) / scale).max())
            for run, method in ((ours, "dop853"), (scipys, "DOP853"))
        )
        bound = BESIDE * them + FLOOR
        print(f"  {name:20} dop853 {us:.1e}, SciPy's {them:.1e}")
        text = f"{name}, dop853, rtol {TOLERANCE:g}: largest error at {LOOKS} times"
        rows.append(
            claim(text, us, f"at most {bound:.1e}", us <= bound, f"SciPy at {TIGHT:g}; {BESIDE:g} times its own")
        )
    return rows


def published() -> list[Claim]:
    rows = []
    orbit = reference("nbody", "arenstorf")["arenstorf_4loop"]
    states = np.array(orbit["states_quad_x_y_vx_vy"], dtype=float)
    stars = reference("nbody", "quad_states")["pleiades"]
    order = [6 * body + part for part in (0, 1, 3, 4) for body in range(7)]
    for method in ("dop853", "dormand-prince45"):
        found = ours(ODES["arenstorf"](), np.array(orbit["times"], dtype=float), method, TIGHT, TIGHT)
        off, bound = float(np.abs(found - states).max()), 1e-6
        text = f"Arenstorf's orbit, {method}, rtol {TIGHT:g}: largest error at {len(states)} times"
        source = "binary128, Taylor; 1e-13 a step for a thousand, and the Moon's passages multiply an error by 1e4"
        rows.append(at_most(text, off, bound, source))
        found = ours(ODES["pleiades"](), np.array(stars["times"], dtype=float), method, TIGHT, TIGHT)
        exact = np.array(stars["reference_states_quad"], dtype=float)[:, order]
        for what, value, source in (
            ("largest error at its times", np.abs(found - exact).max(), "binary128, Taylor"),
            ("end", np.abs(found[-1] - stars["ivptestset_y3"]).max(), f"{TEST_SET}, PLEI"),
        ):
            off, bound = float(value), 1e-9
            text = f"Pleiades, {method}, rtol {TIGHT:g}: {what}"
            rows.append(claim(text, off, f"at most {bound:g}", off <= bound, source))
    return rows


def stiff(long: bool) -> list[Claim]:
    """The four problems with each method."""
    rows, found = [], reference("ode", "ivp_testset")
    for name, (key, atol) in STIFF.items():
        problem = ODES[name](mu=1000.0) if key == "vdpol" else ODES[name]()
        end, wanted = np.array([found[key]["t_end"]]), np.array(found[key]["reference"])
        line = []
        for method, theirs in METHODS.items():
            y = ours(problem, end, method, RTOL, atol)[0]
            off, bound = float(np.abs(y / wanted - 1.0).max()), GLOBAL * RTOL
            text = f"{key.upper()}, {method}, rtol {RTOL:g}: largest relative error at t = {end[0]:g}"
            rows.append(at_most(text, off, bound, TEST_SET))
            line.append(f"{method} {off:.1e}")
            if theirs:
                other = float(np.abs(scipys(problem, end, theirs, RTOL, atol)[0] / wanted - 1.0).max())
                text = f"{key.upper()}, {method}: that error over SciPy's own"
                ratio, source = off / other, f"SciPy's solve_ivp, {theirs}"
                rows.append(at_most(text, ratio, BESIDE, source))
        print(f"  {key.upper():6} {', '.join(line)}", flush=True)
    return [*rows, *(decades(found["rober_decades"]) if long else [])]


def decades(table: dict[str, Any]) -> list[Claim]:
    """ROBER at every power of ten."""
    times, wanted = np.array(table["t"]), np.array(table["y"])
    rows = []
    for method in METHODS:
        off = float(np.abs(ours(ODES["robertson"](), times, method, RTOL, 1e-20) / wanted - 1.0).max())
        text = f"ROBER at {len(times)} decades of time, {method}: largest relative error"
        rows.append(at_most(text, off, GLOBAL * RTOL, "SciPy's Radau at rtol 1e-12"))
    return rows


def backward_euler() -> list[Claim]:
    """First order on a stiff problem."""
    table, errors = reference("ode", "ivp_testset")["rober_decades"], []
    place = table["t"].index(40.0)
    for steps in (1000, 2000):
        sim = kd.Simulation(ODES["robertson"](), "backward-euler", dt=40.0 / steps)
        sim.run(steps, every=steps)
        errors.append(float(np.abs(sim.state.y / table["y"][place] - 1.0).max()))
    order = float(np.log2(errors[0] / errors[1]))
    text = f"ROBER to t = 40, backward-euler, errors {errors[0]:.1e} and {errors[1]:.1e} at half the step: power of dt"
    return [claim(text, order, "1 within 0.1", abs(order - 1) <= 0.1, "SciPy's Radau at rtol 1e-12")]


def claims(long: bool = False) -> list[Claim]:
    """``long`` adds ROBER at each decade."""
    return [*dense(), *published(), *stiff(long), *backward_euler()]


if __name__ == "__main__":
    main(claims, __doc__)
