"""Constraints as users state them: distances between particles, along bonds, across angles, in rigid molecules."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence, Sized
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Protocol

import numpy as np

from kickdrift.errors import InputError
from kickdrift.model.box.box import Box
from kickdrift.model.checks.arguments import checked_arguments
from kickdrift.model.checks.values import is_number, listed, number
from kickdrift.model.molecules.relatives import Ids, molecules_of
from kickdrift.model.molecules.topology import Topology, is_index, items_of
from kickdrift.model.state import Floats, State
from kickdrift.model.units.quantities import quantity
from kickdrift.model.units.unit_systems import UnitSystem
from kickdrift.text import shown, suggestion

ROUNDING = float(np.finfo(float).eps)
LEAST_TOLERANCE, MOST_TOLERANCE = 1e-17, 1e-2
HYDROGEN = re.compile(r"H(?![a-z])")  # names such as H, H1 and HW, but not He
DEUTERIUM = re.compile(r"D\d*")  # D and D1, where masses are in u
HYDROGEN_MASSES = (0.9, 2.1)  # in u, deuterium included
KINDS = ("pairs", "bonds", "hydrogen", "angles", "rigid")
FLAT = 1e-4  # smallest height over the length of a molecule that is not flat


class Joined(Protocol):
    """Particles of molecules; see ``System``."""

    @property
    def state(self) -> State: ...

    @property
    def box(self) -> Box: ...

    @property
    def units(self) -> UnitSystem: ...

    @property
    def species(self) -> tuple[str, ...]: ...

    @property
    def species_index(self) -> np.ndarray: ...

    @property
    def dimensions(self) -> int: ...

    @property
    def topology(self) -> Topology | None: ...

    @property
    def name(self) -> str: ...

    def body(self, i: int) -> str: ...


class Distances(NamedTuple):
    """Pairs of particles (c, 2), and the distance (c,) that each keeps."""

    pairs: Ids
    lengths: Floats


@checked_arguments
@dataclass(frozen=True, eq=False)
class Constraint:
    """Distances between particles that a run keeps: rigid bonds, rigid angles, rigid molecules.

    Give one of ``pairs``, ``bonds``, ``hydrogen``, ``angles`` and ``rigid``. Particles that constraints join form a
    molecule. A distance that is not given is the distance at the start.

    Parameters
    ----------
    pairs : ((i, j), …)
        Particles, counted from 0.
    bonds : a type of bonds of the topology, a list of types, or True for all bonds
    hydrogen : True for all bonds to hydrogen: one end has the mass of hydrogen or deuterium, or a species such as H1
    angles : a type of angles of the topology, a list of types, or True; both bonds of each must be constrained, too
    rigid : True for all molecules of the topology, or a list of molecules, each a list of particles
    distance : of pairs and bonds: one for all, or one for each pair; numbers, or texts such as "1 angstrom"
    angle : of angles, in degrees, or a text such as "104 deg"
    tolerance : largest relative error of the squared distances that the solution leaves before rounding; default 2^-52.
        A method is symplectic, and goes back to its start, only at rounding level

    Raises
    ------
    InputError
        If these contradict each other. A System refuses further what its particles do not allow.
    """

    pairs: Any = None
    bonds: Any = None
    hydrogen: bool = False
    angles: Any = None
    rigid: Any = None
    distance: Any = None
    angle: float | str | None = None
    tolerance: float = ROUNDING

    def __post_init__(self) -> None:
        given = [key for key in KINDS if (value := getattr(self, key)) is not None and value is not False]
        if len(given) != 1:
            raise InputError(
                f"constraint: expected exactly one of {', '.join(KINDS)}, got {' and '.join(given) or 'none'}"
            )
        put = object.__setattr__
        kind = given[0]
        if self.hydrogen not in (True, False):
            raise InputError(f"constraint: hydrogen: expected true or false, got {shown(self.hydrogen)}")
        stated = getattr(self, kind)
        if isinstance(stated, Sized) and not isinstance(stated, str) and not len(stated):
            raise InputError(f"constraint: {kind}: the list is empty; leave out the constraint instead")
        if kind == "pairs":
            put(self, "pairs", items_of("constraint: pairs", self.pairs, 2))
        if self.distance is not None:
            if kind in ("angles", "rigid"):
                raise InputError(f"constraint: distance: goes with pairs, bonds or hydrogen, not with {kind}")
            put(self, "distance", _lengths(self.distance, len(self.pairs) if kind == "pairs" else None))
        if self.angle is not None:
            if kind != "angles":
                raise InputError(f"constraint: angle: goes with angles, not with {kind}")
            if not (isinstance(self.angle, str) or 0.0 < number(self.angle) < 180.0):
                raise InputError(f"constraint: angle: expected degrees between 0 and 180, got {shown(self.angle)}")
        if not is_number(self.tolerance) or not LEAST_TOLERANCE <= self.tolerance <= MOST_TOLERANCE:
            raise InputError(
                f"constraint: tolerance: expected a number from {LEAST_TOLERANCE:g}, below which all is rounding, to "
                f"{MOST_TOLERANCE:g}, got {shown(self.tolerance)}"
            )

    def in_units(self, units: UnitSystem) -> Constraint:
        """The same constraint with numbers in these units in place of texts such as "1 angstrom"."""

        def converted(key: str, value: Any, dimension: str) -> Any:
            return quantity(value, dimension, units, f"constraint: {key}") if isinstance(value, str) else value

        distance = self.distance
        if isinstance(distance, list):
            distance = [converted("distance", each, "length") for each in distance]
        return replace(
            self,
            distance=converted("distance", distance, "length"),
            angle=converted("angle", self.angle, "angle"),
        )

    def distances(self, system: Joined, before: Distances) -> Distances:
        """The pairs of a System that this keeps apart; ``before`` are those of the other constraints."""
        if self.pairs is not None:
            pairs = self.pairs
        elif self.angles is not None:
            return self._across(system, before)
        elif self.rigid is not None and self.rigid is not False:
            pairs = np.concatenate([_rigid_pairs(system, each) for each in self._molecules(system)])
        else:
            pairs = self._bonds(system)
        check_particles(pairs, len(system.state))
        found = apart(system, pairs) if self.distance is None else np.broadcast_to(self.distance, len(pairs))
        return Distances(pairs, np.array(found, dtype=float))

    def _bonds(self, system: Joined) -> Ids:
        if system.topology is None or not len(system.topology.bonds):
            raise InputError("constraint: the system lists no bonds; [topology] lists them")
        if not self.hydrogen:
            return _of_types(system.topology, "bonds", self.bonds)
        bonds = system.topology.bonds
        light = is_hydrogen(system)
        chosen = bonds[light[bonds].any(axis=1)]
        if not len(chosen):
            raise InputError(
                "constraint: hydrogen: no bond has an end with the mass of hydrogen, or with a species such as H or HW"
            )
        return chosen

    def _across(self, system: Joined, before: Distances) -> Distances:
        """Distances between the ends of angles, from the distances along both bonds of each."""
        if system.topology is None or not len(system.topology.angles):
            raise InputError("constraint: the system lists no angles; [topology] lists them")
        angles = _of_types(system.topology, "angles", self.angles)
        pairs = angles[:, [0, 2]]
        pairs_before = map(tuple, np.sort(before.pairs, axis=1).tolist())
        known = dict(zip(pairs_before, before.lengths.tolist(), strict=True))
        lengths, cosine = [], 0.0 if self.angle is None else math.cos(math.radians(number(self.angle)))
        for i, j, k in angles.tolist():
            a, b = (known.get((min(end, j), max(end, j)), 0.0) for end in (i, k))
            if not (a and b):
                end = k if a else i
                raise InputError(
                    f"constraint: angle {i}-{j}-{k}: its bond {end}-{j} has no constraint; a rigid angle needs both "
                    "bonds rigid"
                )
            lengths.append(math.sqrt(a * a + b * b - 2.0 * a * b * cosine))
        return Distances(pairs, apart(system, pairs) if self.angle is None else np.array(lengths))

    def _molecules(self, system: Joined) -> list[list[int]]:
        """Rigid molecules, as lists of particles."""
        if self.rigid is not True:
            given = listed("constraint: rigid", self.rigid, "true, or a list of molecules")
            found = [listed("constraint: rigid", each, "the particles of a molecule") for each in given]
            n = len(system.state)
            for each in found:
                if not all(map(is_index, each)) or len(set(each)) < max(2, len(each)) or max(each) >= n:
                    raise InputError(
                        f"constraint: rigid: expected two or more of the particles 0 to {n - 1}, got {shown(each)}"
                    )
            return found
        if system.topology is None or not len(system.topology.bonds):
            raise InputError(
                "constraint: rigid: the system lists no bonds, which join molecules; [topology] lists them"
            )
        molecule = molecules_of(system.topology.bonds, len(system.state))
        order = np.argsort(molecule, kind="stable")
        parts = np.split(order, np.cumsum(np.bincount(molecule))[:-1])
        return [part.tolist() for part in parts if len(part) > 1]


@contextmanager
def numbered(k: int, what: str = "constraint") -> Iterator[None]:
    """Context in which the message of an InputError names the constraint, or ``what``, by its number k."""
    try:
        yield
    except InputError as error:
        raise InputError(str(error).replace(f"{what}: ", f"{what}[{k}]: ", 1)) from None


def check_particles(pairs: Ids, n: int) -> None:
    """Refuse pairs (c, 2) with a particle beyond the ``n`` of a System."""
    if (wrong := np.flatnonzero((pairs >= n).any(axis=1))).size:
        raise InputError(
            f"constraint: pair {pairs[wrong[0]].tolist()}: there is no particle {pairs[wrong[0]].max()}; particles "
            f"are 0 to {n - 1}"
        )


def _lengths(values: Any, count: int | None) -> str | float | list[Any] | Floats:
    """Checked distances: one, or one for each of ``count`` pairs. Texts stay until the units are known."""
    if isinstance(values, str):
        return values
    one = is_number(values)
    given = [values] if one else listed("constraint: distance", values, "a length, or one for each pair")
    if any(isinstance(each, str) for each in given):
        return given
    found = np.array(given)
    if found.dtype.kind not in "iuf" or not (np.isfinite(found) & (found > 0)).all():
        raise InputError(f"constraint: distance: expected a length above zero, got {shown(values)}")
    if one:
        return float(values)
    if len(found) != count:
        raise InputError(
            "constraint: distance: expected one length"
            + ("" if count is None else f", or one for each of {count} pairs")
            + f", got {len(found)}"
        )
    return found.astype(float)


def apart(system: Joined, pairs: Ids) -> Floats:
    """Distances (c,) between the nearest images of the particles in each pair (c, 2)."""
    x = system.state.phase[0]
    found = np.linalg.norm(system.box.minimum_image((x[:, pairs[:, 0]] - x[:, pairs[:, 1]]).T), axis=1)
    if (same := np.flatnonzero(found == 0)).size:
        i, j = pairs[same[0]].tolist()
        raise InputError(
            f"constraint: {system.body(i)} and {system.body(j)} are at one place; no distance is there to keep"
        )
    return np.asarray(found)


def is_hydrogen(system: Joined) -> np.ndarray:
    """Whether each particle is hydrogen, by its mass in units with a real mass, or by its species."""
    real = system.units.mass == "u"
    light = [bool(HYDROGEN.match(name) or (real and DEUTERIUM.fullmatch(name))) for name in system.species]
    named = np.array(light)[system.species_index]
    if not real:
        return named
    low, high = HYDROGEN_MASSES
    return named | ((system.state.masses > low) & (system.state.masses < high))


def _of_types(topology: Topology, kind: str, types: Any) -> Ids:
    """Bonds or angles of these types."""
    every: Ids = getattr(topology, kind)
    if types is True:
        return every
    own = topology.types(kind)
    names = (
        [types] if isinstance(types, str) else listed(f"constraint: {kind}", types, "true, a type, or a list of types")
    )
    for name in names:
        if name not in own:
            known = dict.fromkeys(own)
            hint = suggestion(name, known) if isinstance(name, str) else ""
            raise InputError(
                f"constraint: {kind}: the system has no {kind} of type {shown(name)}{hint}; its types are "
                f"{', '.join(known)}"
            )
    return every[np.isin(np.array(own), names)]


def _rigid_pairs(system: Joined, members: Sequence[int]) -> Ids:
    """Pairs whose distances make a molecule rigid.

    Four corners span the space, three in two dimensions. Each further particle joins all of them but one, so that it
    lies off the plane or line of those. A molecule without such corners gets pairs that depend on each other.
    """
    n, d, which = len(members), system.dimensions, np.array(members, np.int64)
    corners = np.arange(min(n, d + 1))
    shares = np.repeat(np.eye(d + 1)[:, [d]], n, axis=1)  # of the corners in each particle's place
    if n > d + 1:
        from scipy.linalg import qr

        x = system.state.phase[0][:, which]
        x = system.box.minimum_image((x - x[:, :1]).T)[:, :d].T
        spans, order = qr(x[:, 1:], mode="r", pivoting=True)
        heights = np.abs(np.diag(spans))
        if heights[-1] > FLAT * heights[0]:
            corners = np.append(0, 1 + order[:d])
            others = np.linalg.solve(x[:, corners[1:]], x)
            shares = np.concatenate([1.0 - others.sum(axis=0, keepdims=True), others])
    rows = [(corners[a], corners[b]) for b in range(len(corners)) for a in range(b)]
    for k in np.setdiff1d(np.arange(n), corners):
        rows += [(corner, k) for corner in np.delete(corners, np.argmax(np.abs(shares[:, k])))]
    return np.asarray(which[np.array(rows)])
