"""Results from runs: observables of a run's frames, with error bars.

The names below are public. Each is imported at its first use, so importing this package costs nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from kickdrift.analysis.certify.certificate import EnsembleChecks, ForceChecks
    from kickdrift.analysis.certify.certifying import engine_checks, ensemble_checks
    from kickdrift.analysis.certify.force_testing import force_checks
    from kickdrift.analysis.clusters.binaries import Binary, binaries
    from kickdrift.analysis.clusters.cluster import Cluster, cluster
    from kickdrift.analysis.clusters.report import ClusterReport, cluster_columns, cluster_report
    from kickdrift.analysis.compare.engine_forces import EngineComparison, EngineForces, compare_engines
    from kickdrift.analysis.compare.sampling import SamplingComparison, SamplingRow
    from kickdrift.analysis.crystals.elastic import ElasticConstants, elastic_constants
    from kickdrift.analysis.crystals.potential import Crystal, PotentialFile, potential_file
    from kickdrift.analysis.observables.chains import ChainStatistics, chain_diffusion, chain_statistics
    from kickdrift.analysis.observables.dielectric import Dielectric, dielectric_constant
    from kickdrift.analysis.observables.motion import Diffusion, mean_squared_displacement, velocity_autocorrelation
    from kickdrift.analysis.observables.pressure import pressure_tensor
    from kickdrift.analysis.observables.structure import radial_distribution, structure_factor
    from kickdrift.analysis.orbits.observed import radial_velocities, radial_velocity, sky_offset, sky_offsets
    from kickdrift.analysis.orbits.orbits import orbital_elements
    from kickdrift.analysis.orbits.section import Section, poincare_section
    from kickdrift.analysis.orbits.secular_report import OrbitReport, ProperOrbit, Resonance
    from kickdrift.analysis.orbits.secular_run import orbit_report
    from kickdrift.statistics.blocks import block_average
    from kickdrift.statistics.quasi_periodic import Spectrum

# No name here may be a module's name in this folder: loading that module would replace the function.
_HOMES = {
    "Binary": "kickdrift.analysis.clusters.binaries",
    "ChainStatistics": "kickdrift.analysis.observables.chains",
    "Cluster": "kickdrift.analysis.clusters.cluster",
    "ClusterReport": "kickdrift.analysis.clusters.report",
    "Crystal": "kickdrift.analysis.crystals.potential",
    "Dielectric": "kickdrift.analysis.observables.dielectric",
    "Diffusion": "kickdrift.analysis.observables.motion",
    "ElasticConstants": "kickdrift.analysis.crystals.elastic",
    "EngineComparison": "kickdrift.analysis.compare.engine_forces",
    "EngineForces": "kickdrift.analysis.compare.engine_forces",
    "EnsembleChecks": "kickdrift.analysis.certify.certificate",
    "ForceChecks": "kickdrift.analysis.certify.certificate",
    "OrbitReport": "kickdrift.analysis.orbits.secular_report",
    "PotentialFile": "kickdrift.analysis.crystals.potential",
    "ProperOrbit": "kickdrift.analysis.orbits.secular_report",
    "Resonance": "kickdrift.analysis.orbits.secular_report",
    "SamplingComparison": "kickdrift.analysis.compare.sampling",
    "SamplingRow": "kickdrift.analysis.compare.sampling",
    "Section": "kickdrift.analysis.orbits.section",
    "Spectrum": "kickdrift.statistics.quasi_periodic",
    "binaries": "kickdrift.analysis.clusters.binaries",
    "block_average": "kickdrift.statistics.blocks",
    "chain_diffusion": "kickdrift.analysis.observables.chains",
    "chain_statistics": "kickdrift.analysis.observables.chains",
    "cluster": "kickdrift.analysis.clusters.cluster",
    "cluster_columns": "kickdrift.analysis.clusters.report",
    "cluster_report": "kickdrift.analysis.clusters.report",
    "compare_engines": "kickdrift.analysis.compare.engine_forces",
    "dielectric_constant": "kickdrift.analysis.observables.dielectric",
    "elastic_constants": "kickdrift.analysis.crystals.elastic",
    "engine_checks": "kickdrift.analysis.certify.certifying",
    "ensemble_checks": "kickdrift.analysis.certify.certifying",
    "force_checks": "kickdrift.analysis.certify.force_testing",
    "mean_squared_displacement": "kickdrift.analysis.observables.motion",
    "orbit_report": "kickdrift.analysis.orbits.secular_run",
    "orbital_elements": "kickdrift.analysis.orbits.orbits",
    "poincare_section": "kickdrift.analysis.orbits.section",
    "potential_file": "kickdrift.analysis.crystals.potential",
    "pressure_tensor": "kickdrift.analysis.observables.pressure",
    "radial_distribution": "kickdrift.analysis.observables.structure",
    "radial_velocities": "kickdrift.analysis.orbits.observed",
    "radial_velocity": "kickdrift.analysis.orbits.observed",
    "sky_offset": "kickdrift.analysis.orbits.observed",
    "sky_offsets": "kickdrift.analysis.orbits.observed",
    "structure_factor": "kickdrift.analysis.observables.structure",
    "velocity_autocorrelation": "kickdrift.analysis.observables.motion",
}

__all__ = [
    "Binary",
    "ChainStatistics",
    "Cluster",
    "ClusterReport",
    "Crystal",
    "Dielectric",
    "Diffusion",
    "ElasticConstants",
    "EngineComparison",
    "EngineForces",
    "EnsembleChecks",
    "ForceChecks",
    "OrbitReport",
    "PotentialFile",
    "ProperOrbit",
    "Resonance",
    "SamplingComparison",
    "SamplingRow",
    "Section",
    "Spectrum",
    "binaries",
    "block_average",
    "chain_diffusion",
    "chain_statistics",
    "cluster",
    "cluster_columns",
    "cluster_report",
    "compare_engines",
    "dielectric_constant",
    "elastic_constants",
    "engine_checks",
    "ensemble_checks",
    "force_checks",
    "mean_squared_displacement",
    "orbit_report",
    "orbital_elements",
    "poincare_section",
    "potential_file",
    "pressure_tensor",
    "radial_distribution",
    "radial_velocities",
    "radial_velocity",
    "sky_offset",
    "sky_offsets",
    "structure_factor",
    "velocity_autocorrelation",
]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'kickdrift.analysis' has no attribute {name!r}")
    value = getattr(import_module(_HOMES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """Public names, and those of Python itself."""
    return [*__all__, "__all__", "__doc__", "__file__", "__name__", "__path__", "__spec__"]
