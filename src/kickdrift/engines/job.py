"""What an engine is asked for, and the heat baths of the engines."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from kickdrift.integrators.method import Method
    from kickdrift.integrators.options import Options
    from kickdrift.model.system import System


@dataclass(frozen=True)
class Job:
    """Request of a Simulation to an engine. ``named`` is the requested name of the method; ``hosts`` are the machines
    of the processes by name, with the number of processes that each takes."""

    system: System
    method: Method
    named: str
    options: Options
    threads: int = 1
    processes: int = 1
    hosts: Mapping[str, int] | None = None


class EngineBath(NamedTuple):
    """A heat bath of another program.

    Attributes
    ----------
    name : the program's own name
    tells : whether the program tells the heat, so that conservation can be judged
    remark : the difference from kickdrift's method, if there is one
    """

    name: str
    tells: bool = True
    remark: str = ""


ASE_BATHS = {
    "baoab": EngineBath("LangevinBAOAB", tells=False),
    "csvr": EngineBath("Bussi", remark="ASE's Bussi rescales velocities once a step, before velocity Verlet"),
    "nose-hoover": EngineBath(
        "NoseHooverChainNVT",
        remark="ASE's NoseHooverChainNVT counts 3 N degrees of freedom, although 3 N - 3 move: "
        "the temperature is N / (N - 1) times the one asked for",
    ),
    "andersen": EngineBath(
        "Andersen", tells=False, remark="ASE's Andersen draws each velocity component by itself, inside the step"
    ),
}
LAMMPS_BATHS = {
    "baoab": EngineBath(
        "fix langevin",
        remark="LAMMPS' fix langevin adds drag and noise to the forces; it is not BAOAB, so errors of the step differ",
    ),
    "csvr": EngineBath("fix temp/csvr", remark="LAMMPS' fix temp/csvr rescales velocities once a step, at the end"),
    "nose-hoover": EngineBath("fix nvt"),
}
OPENMM_BATHS = {
    **{name: EngineBath("CustomIntegrator") for name in ("baoab", "obabo", "aboba", "oabao")},
    "baoa": EngineBath("LangevinMiddleIntegrator", tells=False),
    "nose-hoover": EngineBath(
        "NoseHooverIntegrator",
        remark="OpenMM's NoseHooverIntegrator has its chain in the middle of the drift, so errors of the step differ",
    ),
    "andersen": EngineBath("AndersenThermostat"),
}
CUDA_BATHS = {
    **{name: EngineBath(name) for name in ("baoab", "obabo", "aboba", "oabao", "baoa", "gjf", "andersen", "csvr")},
    "nose-hoover": EngineBath("nose-hoover", remark="on a device, a run that is resumed begins with a chain at rest"),
}
RESCALING = "CN"  # letters of baths that scale all velocities by one factor
