"""Systems in other units: the same particles and forces, with all their numbers converted."""

from __future__ import annotations

from collections.abc import Mapping
from inspect import signature
from math import prod
from typing import Any

import numpy as np

from kickdrift.errors import InputError
from kickdrift.forces import FORCES
from kickdrift.forces.many_body.base import ManyBodyForce
from kickdrift.forces.pairs.law import PairForce
from kickdrift.forces.tables.given import Tables
from kickdrift.integrators.asked import known_options
from kickdrift.model.box.box import Box
from kickdrift.model.fixed import Fixed
from kickdrift.model.molecules.constraint import Constraint
from kickdrift.model.molecules.virtual_sites import VirtualSite
from kickdrift.model.run_defaults import Equilibration, RunDefaults
from kickdrift.model.stages import Stage
from kickdrift.model.system import System
from kickdrift.model.units.quantities import quantity
from kickdrift.model.units.unit_systems import UnitSystem, powers, unit_system

MOLECULAR = ("metal", "real", "gromacs")  # unit systems with elementary charges, which convert into one another
TIMES = ("dt", "time", "interval", "times")
MINIMUM = {"force": "force", "max_displacement": "length"}  # of a stage's ``minimize``
FUNCTIONS = ("lammps", "python", "beside")  # forces with numbers that kickdrift does not see
BASES = {"L": ("angstrom", "length"), "T": ("ps", "time"), "M": ("u", "mass"), "E": ("eV", "energy")}


def in_units(system: System, name: str) -> System:
    """Return the System in other units; see `System.in_units`."""
    new, old = unit_system(name), system.units
    if new == old:
        return system
    if not {new.name, old.name} <= {*MOLECULAR}:
        raise InputError(f"in_units: {old.name} to {new.name}: possible are {', '.join(MOLECULAR)}")
    if system.events:
        raise InputError(f"in_units: event {system.events[0].kind!r}: events stay behind; take them out (watched([]))")
    scale = _Scale(old, new)
    length = scale("length")
    state, box = system.state, system.box
    species = [system.species[k] for k in system.species_index]
    held, sites, fixed, run_in = system.constraints, system.virtual_sites, system.fixed, system.equilibration
    made = System(
        state.positions * length,
        state.velocities * scale("velocity"),
        state.masses * scale("mass"),
        Box(matrix=box.matrix * length, periodic=box.periodic_axes) if box.periodic else None,
        [_force(force, scale) for force in system.forces],
        new,
        species,
        system.name,
        RunDefaults(**_run(system.run.said(), scale)),
        run_in and Equilibration.of(_run(run_in.said(), scale) | {"interval": run_in.interval}),
        seed=system.seed,
        names=system.names,
        radii=None if system.radii is None else system.radii * length,
        dimensions=system.dimensions,
        topology=system.topology,
        charges=system.charges,
        constraints=held and [Constraint(pairs=held.pairs.tolist(), distance=(held.lengths * length).tolist())],
        virtual_sites=sites and [_site(table, length) for table in sites.tables],
        stages=[_stage(each, scale) for each in system.stages],
        fixed=fixed and [Fixed(**_value(table, "", {"velocity": "velocity"}, scale)) for table in fixed.tables],
    )
    return made.at(made.state.phase, state.time * scale("time"), state.steps_done, state.ids)


def _site(table: Mapping[str, Any], length: float) -> VirtualSite:
    """A virtual site, whose factor of the cross product is an inverse length."""
    return VirtualSite(**dict(table) | {"normal": np.divide(table.get("normal", 0.0), length)})


def _stage(stage: Stage, scale: _Scale) -> Stage:
    """A stage of a protocol with its numbers converted."""
    minimize = None if stage.minimize is None else _value(stage.minimize, "", MINIMUM, scale)
    return Stage(stage.name, keep=stage.keep, minimize=minimize, inherit=stage.inherit, **_run(stage.run, scale))


class _Scale:
    """Factors from one unit system to another, by dimension."""

    def __init__(self, old: UnitSystem, new: UnitSystem) -> None:
        self._bases = {
            key: quantity(f"1 {unit}", dimension, new) / quantity(f"1 {unit}", dimension, old)
            for key, (unit, dimension) in BASES.items()
        }

    def __call__(self, dimension: str) -> float:
        return prod(self._bases.get(key, 1.0) ** power for key, power in powers(dimension).items())


def _force(force: Any, scale: _Scale) -> Any:
    """The force with its parameters converted. Those without a dimension are plain numbers."""
    cls = type(force)
    if FORCES.get(getattr(cls, "name", "")) is not cls or not cls.__module__.startswith("kickdrift."):
        raise InputError(f"in_units: force {force.name!r}: kickdrift does not know the units of its parameters")
    if isinstance(force, ManyBodyForce) or not hasattr(cls, "dimensions") or force.name in FUNCTIONS:
        raise InputError(f"in_units: force {force.name!r}: its numbers are of one unit system alone")
    dimensions: Mapping[str, str] = cls.dimensions
    if isinstance(force, PairForce):
        dimensions = dict(dimensions) | {"cutoff": "length", "switch_start": "length"}
    given = {key: _value(getattr(force, key), key, dimensions, scale) for key in signature(cls).parameters}
    if isinstance(force, Tables):  # whose numbers are of the old units, unless the user says others
        given |= {key: given[key] or scale(dimensions[key]) for key in cls.units_of}
    return cls(**given)


def _value(value: Any, key: str, dimensions: Mapping[str, str], scale: _Scale) -> Any:
    """A parameter converted. Tables of species, pairs and types hold the names of parameters."""
    if key == "parameters":  # of a formula, in the units of the formula
        return value
    if isinstance(value, Mapping):
        return {
            each: _value(one, each if each in dimensions else key, dimensions, scale) for each, one in value.items()
        }
    if key not in dimensions or value is None or isinstance(value, str):
        return value
    if isinstance(value, list | tuple):
        return type(value)(_value(one, key, dimensions, scale) for one in value)
    return value * scale(dimensions[key])


def _run(said: Mapping[str, Any], scale: _Scale) -> dict[str, Any]:
    """Values of a run, converted."""
    options = known_options()
    dimensions = dict.fromkeys(TIMES, "time") | {
        key: option.dimension for key, option in options.items() if option.dimension
    }
    return {key: _value(value, key, dimensions, scale) for key, value in said.items()}
