"""The purpose of a run's compiled code, in words."""

from __future__ import annotations

from kickdrift.model.problem import Problem
from kickdrift.model.system import System


def purpose_of(integrator: str, subject: System | Problem) -> str:
    """The method, and the forces or the Problem: "velocity-verlet for lennard-jones"."""
    forces = subject.forces if isinstance(subject, System) else ()
    names = dict.fromkeys(getattr(force, "name", type(force).__name__) for force in forces)
    return f"{integrator} for {' and '.join(names) or subject.name}"
