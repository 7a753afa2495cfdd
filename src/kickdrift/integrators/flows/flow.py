"""Flows, the views that integrators have of a System or a Problem: y' = f(t, y), with y one array.

y is (2, 3, n) for particles, positions and velocities; (2, 1, n / 2) for a separable Problem; (1, 1, n) for any other.
"""

from __future__ import annotations

from kickdrift.errors import InputError
from kickdrift.forces.around.spins import spinning
from kickdrift.integrators.flows.particle_flow import ParticleFlow
from kickdrift.integrators.flows.problem_flow import ProblemFlow
from kickdrift.integrators.flows.spinning_flow import SpinningFlow
from kickdrift.model.problem import Problem
from kickdrift.model.system import System

Flow = ParticleFlow | ProblemFlow


def flow_of(subject: System | Problem, threads: int, jumps: bool, mixed: bool = False, coupling: str = "") -> Flow:
    """Flow of a System or a Problem. With ``jumps``, trial steps may go far astray. With ``mixed``, pair forces are in
    mixed precision. A barostat's ``coupling`` says which edges change."""
    if isinstance(subject, System):
        kind = SpinningFlow if spinning(subject) else ParticleFlow
        return kind(subject, threads, jumps, mixed, coupling)
    if mixed and isinstance(subject, Problem):
        raise InputError(f"precision: mixed needs pair forces; {subject.name!r} is an ODE")
    if isinstance(subject, Problem):
        return ProblemFlow(subject, threads, jumps)
    raise InputError(f"a Simulation takes a System or a Problem, got {type(subject).__name__}")
