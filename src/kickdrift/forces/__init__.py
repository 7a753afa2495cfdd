"""Forces that ship with kickdrift. Importing this module compiles nothing."""

from __future__ import annotations

from typing import Any

from kickdrift.forces.around.gas import DynamicalFriction, GasDrag, Migration
from kickdrift.forces.around.mass_change import MassChange
from kickdrift.forces.around.oblateness import CentralPotential, Oblateness
from kickdrift.forces.around.radiation import NonGravitational, RadiationPressure
from kickdrift.forces.around.relativity import EinsteinInfeldHoffmann, LenseThirring, PostNewtonian, RadiationReaction
from kickdrift.forces.around.spins import TidesSpin
from kickdrift.forces.around.tides import Tides
from kickdrift.forces.beside.unknowns import Beside
from kickdrift.forces.bonded.cmap import Cmap
from kickdrift.forces.bonded.formula import FormulaAngle, FormulaBond, FormulaDihedral, FormulaImproper
from kickdrift.forces.bonded.own_pairs import ListedPairs
from kickdrift.forces.bonded.shipped import (
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
from kickdrift.forces.bonded.tabulated import TabulatedAngle, TabulatedBond, TabulatedDihedral
from kickdrift.forces.charges.coulomb import Coulomb
from kickdrift.forces.external.calculator import CalculatorForce
from kickdrift.forces.external.lammps import LammpsForce
from kickdrift.forces.external.python import PythonForce
from kickdrift.forces.fields.galaxy import Galaxy
from kickdrift.forces.fields.restraint import Restraint
from kickdrift.forces.fields.shipped import DrivenField, HarmonicTrap, Hill, LinearDrag, Springs, UniformField
from kickdrift.forces.fields.walls import HarmonicWall, LennardJonesWall, ReflectingWall
from kickdrift.forces.gravity.direct import Gravity
from kickdrift.forces.gravity.sheet import GravitySheet
from kickdrift.forces.many_body.embedded_atom import EmbeddedAtom
from kickdrift.forces.many_body.stillinger_weber import StillingerWeber
from kickdrift.forces.many_body.tersoff import Tersoff
from kickdrift.forces.pairs.formula import FormulaPair
from kickdrift.forces.pairs.lennard_jones import LennardJones
from kickdrift.forces.pairs.shipped import (
    BornMayerHuggins,
    Buckingham,
    GaussianCore,
    Mie,
    MorsePair,
    SoftPair,
    WeeksChandlerAndersen,
    Yukawa,
    Zbl,
)
from kickdrift.forces.pairs.tabulated import Tabulated
from kickdrift.forces.seam.named import FORCES, registered
from kickdrift.forces.tree.force import GravityTree

_ALL: tuple[Any, ...] = (
    LennardJones,
    Mie,
    WeeksChandlerAndersen,
    Buckingham,
    BornMayerHuggins,
    MorsePair,
    Yukawa,
    GaussianCore,
    SoftPair,
    Zbl,
    Tabulated,
    FormulaPair,
    Coulomb,
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
    Beside,
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
    TabulatedBond,
    TabulatedAngle,
    TabulatedDihedral,
    FormulaBond,
    FormulaAngle,
    FormulaDihedral,
    FormulaImproper,
    Cmap,
    ListedPairs,
    HarmonicTrap,
    Hill,
    UniformField,
    DrivenField,
    LinearDrag,
    Galaxy,
    Restraint,
    HarmonicWall,
    LennardJonesWall,
    ReflectingWall,
    PythonForce,
    CalculatorForce,
    LammpsForce,
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
