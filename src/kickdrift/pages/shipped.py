"""The pages that ship: what each one runs, and what it says."""

import math
import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

from kickdrift.errors import InputError
from kickdrift.integrators import INTEGRATORS
from kickdrift.integrators.runge_kutta.method import Tableau
from kickdrift.model.problem import Problem
from kickdrift.model.state import State
from kickdrift.odes import ODES
from kickdrift.pages.equations import checked_problem, compared, own_runs, shown_problem, stepper_of
from kickdrift.pages.module import Module
from kickdrift.pages.particles import checked_system, liquid_runs, page_system, shown_system, system_runs
from kickdrift.pages.planets import planets_runs, shown_planets
from kickdrift.systemfile.files import is_shipped
from kickdrift.systemfile.python_file import load_or_run
from kickdrift.systemfile.reading import load
from kickdrift.text import shown, suggestion


class Page(NamedTuple):
    """A page.

    Attributes
    ----------
    title : its heading
    about : a sentence for people who see no figures
    script : its file in ``assets``
    runs : a function of a `Module` that returns what the page runs, by name
    python : lines that do the same in Python
    shown : returns what the script knows beside the runs, such as a scene for the viewer
    """

    title: str
    about: str
    script: str
    runs: Callable[[Module], dict[str, Any]]
    python: str
    shown: Callable[[], dict[str, Any]] | None = None


def _linear(t: float, y: Any) -> Any:
    """z' = lambda z with complex numbers: y is z, then lambda, real and imaginary parts."""
    return y[2] * y[0] - y[3] * y[1], y[3] * y[0] + y[2] * y[1], 0.0, 0.0


def _stability(module: Module) -> dict[str, Any]:
    """Every explicit Runge-Kutta method with fixed steps on z' = lambda z, by name."""
    problem = Problem(_linear, [1.0, 0.0, 0.0, 0.0], name="z' = lambda z")
    methods = {each.name: each for each in INTEGRATORS.values() if isinstance(each, Tableau)}
    return {
        name: module.runs(*stepper_of(problem, _with_fixed_steps(each), 1.0)) | {"order": each.order}
        for name, each in methods.items()
    }


def _double_pendulum(t: float, y: Any) -> Any:
    a, b, u, w = y[0], y[1], y[2], y[3]
    s, c = math.sin(a - b), math.cos(a - b)
    share = 1.0 / (4.0 - 2.0 * c * c)
    lower = 2.0 * s * (2.0 * u * u + 2.0 * math.cos(a) + w * w * c)
    upper = -3.0 * math.sin(a) - math.sin(a - 2.0 * b) - 2.0 * s * (w * w + u * u * c)
    return u, w, share * upper, share * lower


def _energy_of_double_pendulum(t: float, y: Any) -> float:
    swing = y[2] * y[2] + 0.5 * y[3] * y[3] + y[2] * y[3] * math.cos(y[0] - y[1])
    return swing - 2.0 * math.cos(y[0]) - math.cos(y[1])


def double_pendulum(y0: Sequence[float] = (2.0, 2.5, 0.0, 0.0)) -> Problem:
    """Two pendulums, one on the other, of masses and lengths 1 where g = 1; y is two angles and their velocities.

    Source: Shinbrot, Grebogi, Wisdom & Yorke 1992, doi:10.1119/1.16860."""
    return Problem(_double_pendulum, y0, energy=_energy_of_double_pendulum, name="double-pendulum")


def _three_bodies(t: float, y: Any) -> Any:
    x12, y12, x13, y13, x23, y23 = y[2] - y[0], y[3] - y[1], y[4] - y[0], y[5] - y[1], y[4] - y[2], y[5] - y[3]
    a, b, c = x12 * x12 + y12 * y12, x13 * x13 + y13 * y13, x23 * x23 + y23 * y23
    a, b, c = 1.0 / (a * math.sqrt(a)), 1.0 / (b * math.sqrt(b)), 1.0 / (c * math.sqrt(c))
    return (
        y[6], y[7], y[8], y[9], y[10], y[11], a * x12 + b * x13, a * y12 + b * y13, c * x23 - a * x12,
        c * y23 - a * y12, -b * x13 - c * x23, -b * y13 - c * y23,
    )  # fmt: skip


def three_bodies(y0: Sequence[float] | None = None) -> Problem:
    """Three bodies of mass 1 in a plane where G = 1; y is three positions and three velocities.

    They begin on the figure eight, a periodic orbit, unless ``y0`` says otherwise.

    Source: Chenciner & Montgomery 2000, doi:10.2307/2661357."""
    eight = load("figure-eight").state
    assert isinstance(eight, State)
    start = eight.phase.transpose(0, 2, 1)[:, :, :2].ravel() if y0 is None else y0
    return Problem(_three_bodies, start, name="three-bodies")


def _chaos(module: Module) -> dict[str, Any]:
    """Two methods on four Problems whose motion can be chaotic; names are "problem method"."""
    problems = (double_pendulum(), three_bodies(), ODES["henon-heiles"](), ODES["lorenz"]())
    return {
        f"{problem.name} {name}": module.runs(*stepper_of(problem, _with_fixed_steps(INTEGRATORS[name])))
        for problem in problems
        for name in ("rk4", "dop853")
    }


def _with_fixed_steps(method: Any) -> Tableau:
    """A Runge-Kutta method without its error estimate."""
    return replace(method, errors=(), error_order=0, dense=(), extra=())


SIMULATION = """\
sim = kd.Simulation(system, "{method}", dt={dt}{options})
print(sim.run({steps}, every={every}).energy)"""
SIMULATION_OF_PROBLEM = """\
sim = kd.Simulation(system, "{method}", dt={dt})
sim.run({steps})
print(sim.state.y)"""
PAGES = {
    "which-integrator": Page(
        "Which integrator?",
        "Two methods side by side on an oscillator, a pendulum or an orbit: the path, the energy error, the cost.",
        "which.js",
        compared,
        "import kickdrift as kd\n"
        "from kickdrift.odes import {problem}\n"
        "\n"
        'sim = kd.Simulation({problem}({start}), integrator="{method}", dt={dt})\n'
        "print(sim.run({steps}, every={every}).energy)",
    ),
    "stability": Page(
        "Which step is stable?",
        "Stability regions of the Runge-Kutta methods, with the eigenvalues of an oscillator times the step.",
        "stability.js",
        _stability,
        "import kickdrift as kd\n"
        "from kickdrift.odes import harmonic_oscillator\n"
        "\n"
        'sim = kd.Simulation(harmonic_oscillator(omega={omega}), integrator="{method}"{step})\n'
        "print(sim.run({end}).energy)",
    ),
    "chaos": Page(
        "How fast do neighbours part?",
        "Two copies of a double pendulum, three bodies, a star or the Lorenz equations that begin almost alike.",
        "chaos.js",
        _chaos,
        "import kickdrift as kd\n"
        "from {place} import {problem}\n"
        "\n"
        "sim = kd.Simulation({problem}(y0={start}), integrator={method})\n"
        "sim.run(until={time})\n"
        "print(sim.state.y)",
    ),
    "liquid": Page(
        "A liquid",
        "1000 Lennard-Jones particles that move while you change temperature, cutoff, heat bath and step.",
        "particles.js",
        liquid_runs,
        "import kickdrift as kd\n"
        "\n"
        'system = kd.load("lj-1000").with_forces(kd.LennardJones(cutoff={cutoff}, truncation="shift"))\n' + SIMULATION,
        lambda: shown_system(page_system("lj-1000")),
    ),
    "planets": Page(
        "Planets",
        "The solar system by Wisdom-Holman and by leapfrog, side by side, with planets that you add.",
        "planets.js",
        planets_runs,
        "import kickdrift as kd\n"
        "\n"
        'sim = kd.Simulation(kd.load("solar-system"), "{method}", dt={dt})\n'
        "{lines}print(sim.run(1000, every=10).energy)",
        shown_planets,
    ),
}


def page_of(name: str) -> Page:
    """The page of this name, or of a system: a file's path or the name of a shipped one.

    Raises InputError for an unknown name, and for a system that a page cannot hold."""
    if name in PAGES:
        return PAGES[name]
    if not (is_shipped(name) or os.path.exists(name)):
        raise InputError(
            f"page {shown(name)} is unknown{suggestion(name, PAGES)}; pages: {', '.join(PAGES)}, or a system"
        )
    subject = load_or_run(name)
    lines = f"system = kd.load({name!r})\n"
    if name.endswith(".py"):
        lines = f"from kickdrift.systemfile.python_file import load_or_run\n\nsystem = load_or_run({name!r})\n"
    if isinstance(subject, Problem):
        problem = checked_problem(name, subject)
        return Page(
            problem.name,
            "Two methods side by side: the path and the energy error, or two unknowns over time.",
            "which.js",
            partial(own_runs, problem),
            f"import kickdrift as kd\n{lines}" + SIMULATION_OF_PROBLEM,
            partial(shown_problem, problem),
        )
    system = checked_system(name, subject)
    return Page(
        system.name,
        f"{len(system):,} particles that move while you change method and step.",
        "particles.js",
        partial(system_runs, system),
        f"import kickdrift as kd\n{lines}" + SIMULATION,
        partial(shown_system, system),
    )
