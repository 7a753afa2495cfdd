"""A plugin of pytest: ``kickdrift.solve`` in the place of ``solve_ivp``, before SciPy's tests import it.

Arguments and results pass unchanged. The plugin only notes who took the steps, and in which tests."""

from __future__ import annotations

import os
from collections import Counter
from typing import Any

import kickdrift as kd

STEPS: Counter[str] = Counter()
TESTS: set[str] = set()


def solve(*args: Any, **options: Any) -> kd.Solution:
    """kickdrift.solve, noted."""
    TESTS.add(os.environ["PYTEST_CURRENT_TEST"].split("::")[-1].split(" ")[0])
    found = kd.solve(*args, **options)
    if found.report:
        STEPS[found.report.integrator] += found.report.steps
    return found


def pytest_configure() -> None:
    """Put our function in the place of SciPy's."""
    import scipy.integrate

    scipy.integrate.solve_ivp = solve


def pytest_terminal_summary(terminalreporter: Any) -> None:
    """Who took the steps, and in which tests."""
    for method, steps in STEPS.items():
        terminalreporter.write_line(f"{method} took {steps} steps")
    terminalreporter.write_line(f"tests that call solve: {' '.join(sorted(TESTS))}")
