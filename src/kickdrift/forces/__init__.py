"""Forces that ship with kickdrift. Importing this module compiles nothing."""

from __future__ import annotations

from typing import Any

from kickdrift.forces.bonded import (
    CosineAngle,
    Fene,
    HarmonicAngle,
    HarmonicBond,
    HarmonicImproper,
    MorseBond,
    OplsDihedral,
    PeriodicDihedral,
    PeriodicImproper,
    RyckaertBellemans,
)
from kickdrift.forces.central_potential import CentralPotential
from kickdrift.forces.embedded_atom import EmbeddedAtom
from kickdrift.forces.external import PythonForce
from kickdrift.forces.external_calculator import CalculatorForce
from kickdrift.forces.fields import DrivenField, HarmonicTrap, Hill, LinearDrag, Springs, UniformField
from kickdrift.forces.gas import DynamicalFriction, GasDrag
from kickdrift.forces.gravity import Gravity
from kickdrift.forces.gravity_sheet import GravitySheet
from kickdrift.forces.lennard_jones import LennardJones
from kickdrift.forces.mass_change import MassChange
from kickdrift.forces.migration import Migration
from kickdrift.forces.oblateness import Oblateness
from kickdrift.forces.post_newtonian import EinsteinInfeldHoffmann, LenseThirring, RadiationReaction
from kickdrift.forces.radiation import NonGravitational, RadiationPressure
from kickdrift.forces.registration import FORCES, registered
from kickdrift.forces.relativity import PostNewtonian
from kickdrift.forces.stillinger_weber import StillingerWeber
from kickdrift.forces.tersoff import Tersoff
from kickdrift.forces.tides import Tides
from kickdrift.forces.tides_spin import TidesSpin
from kickdrift.forces.tree import GravityTree

_ALL: tuple[Any, ...] = (
    LennardJones,
    Gravity,
    GravityTree,
    GravitySheet,
    EmbeddedAtom,
    StillingerWeber,
    Tersoff,
    PostNewtonian,
    EinsteinInfeldHoffmann,
    LenseThirring,
    RadiationReaction,
    Oblateness,
    Tides,
    TidesSpin,
    RadiationPressure,
    NonGravitational,
    Migration,
    GasDrag,
    DynamicalFriction,
    CentralPotential,
    MassChange,
    Springs,
    HarmonicBond,
    Fene,
    MorseBond,
    HarmonicAngle,
    CosineAngle,
    PeriodicDihedral,
    RyckaertBellemans,
    OplsDihedral,
    HarmonicImproper,
    PeriodicImproper,
    HarmonicTrap,
    Hill,
    UniformField,
    DrivenField,
    LinearDrag,
    PythonForce,
    CalculatorForce,
)
FORCES.clear()  # laws register themselves, in the order of their modules
FORCES.update({force.name: force for force in _ALL})
__all__ = [force.__name__ for force in _ALL]  # each is also public as kickdrift.NAME
_OWN = {force.__qualname__: force for force in _ALL}


def home(module: str) -> str:
    """Module of a class as run files name it: ``kickdrift`` for all of kickdrift's own classes."""
    return "kickdrift" if module.partition(".")[0] == "kickdrift" else module


def force_class(module: str, name: str) -> Any:
    """Return the class of force with that module and qualified name; None unless it is kickdrift's or registered."""
    own = _OWN.get(name) if home(module) == "kickdrift" else None
    return own or registered(module, name)
