"""Resonance of multiple time steps with the fastest oscillation."""

from __future__ import annotations

import math
from typing import Any

from kickdrift.analysis.compare.pilot import Subject
from kickdrift.integrators.flows.particle_flow import ParticleFlow
from kickdrift.integrators.step_choice.step_length import MOST, fastest
from kickdrift.model.system import System
from kickdrift.text import measured


def resonance(subject: Subject, start: Any) -> list[str]:
    """Note on the longest step of the slow forces, [] without an oscillation or for more than ``MOST`` particles.

    Kicks of slow forces that come twice or more often in a period of the fastest oscillation pump energy into it
    (Biesiadecki & Skeel 1993, J. Comput. Phys. 109, 318, doi:10.1006/jcph.1993.1220)."""
    if not isinstance(subject, System) or len(subject) > MOST:
        return []
    omega = fastest(ParticleFlow(subject, 1, True), start.time, start.phase)
    if not omega > 0:
        return []
    period, unit = 2 * math.pi / omega, measured("", subject.units.symbol("time"))
    return [
        f"resonance: the fastest oscillation has a period of {period:.3g}{unit}, and slow forces resonate with it from "
        f"dt = {period / 2:.3g}{unit} on"
    ]
