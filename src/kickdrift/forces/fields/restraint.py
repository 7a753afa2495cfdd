"""Position restraints: springs that hold particles near places.

This module does not import numba, so reading and checking a system file stays fast; ``bind`` compiles.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from kickdrift.errors import InputError
from kickdrift.forces.fields.shipped import Field
from kickdrift.forces.seam.arguments import (
    Vector,
    check_alike,
    check_massive,
    check_place_in_plane,
    is_one,
    items,
    number,
    vector,
)
from kickdrift.model.checks.arguments import checked_arguments
from kickdrift.text import counted, shown

if TYPE_CHECKING:
    from kickdrift.model.state import Floats
    from kickdrift.model.subject import Subject


@checked_arguments
@dataclass(frozen=True)
class Restraint(Field):
    """Position restraints: U = k |x - x0|^2 / 2 for each held particle, with x - x0 to the nearest image of x0.

    A System that takes this force fixes what is left out: it holds all its particles where they are, in its box. A
    frame of a run keeps these places, so a new run from the frame pulls towards the same places.

    Attributes
    ----------
    stiffness : float, or three of them
        Energy per length squared, zero or more; three numbers apply along x, y and z, in a box that does not lean.
    particles : (i, …)
        Ids of the held particles, counted from 0; default all.
    positions : ((x, y, z), …)
        Reference positions x0, one for each held particle; default where these particles begin.
    scales : bool
        Whether x0 moves with the box (default). The restraint then has a virial, so that a barostat takes it. Without
        it, x0 stays, and barostats refuse the force.
    box : ((ax, ay, az), (bx, by, bz), (cx, cy, cz))
        Edge vectors of the box in which the positions hold; default the System's.
    """

    stiffness: float | Vector
    particles: Sequence[int] | None = None
    positions: Sequence[Vector] | None = None
    scales: bool = True
    box: Sequence[Vector] | None = None

    name: ClassVar[str] = "restraint"
    joins: ClassVar[bool] = True  # held bodies may neither merge nor leave
    dimensions: ClassVar[dict[str, str]] = {"stiffness": "stiffness", "positions": "length", "box": "length"}

    def __post_init__(self) -> None:
        given = self.stiffness
        stiffness = number(self.name, "stiffness", given) if is_one(given) else vector(self.name, "stiffness", given)
        if np.min(stiffness) < 0:
            raise InputError(f"{self.name}: stiffness must be zero or more, got {shown(given)}")
        object.__setattr__(self, "stiffness", stiffness)
        if self.particles is not None:
            object.__setattr__(self, "particles", _ids(self.name, self.particles))
        for key, count in (("positions", None), ("box", 3)):
            if (rows := getattr(self, key)) is not None:
                rows = tuple(vector(self.name, f"{key}[{k}]", row) for k, row in enumerate(items(self.name, key, rows)))
                if count and len(rows) != count:
                    raise InputError(f"{self.name}: {key}: expected three edge vectors, got {len(rows)}")
                object.__setattr__(self, key, rows)
        if None not in (self.particles, self.positions) and len(self.particles) != len(self.positions):  # type: ignore[arg-type]
            raise InputError(
                f"{self.name}: {len(self.positions)} positions for {counted(len(self.particles), 'particle')}"  # type: ignore[arg-type]
            )

    def __str__(self) -> str:
        held = "all particles" if self.particles is None else counted(len(self.particles), "particle")
        return f"Restraint({held}, stiffness={shown(self.stiffness)})"

    def begun(self, system: Subject) -> Restraint:
        """This restraint with the particles, positions and box of a System where it has none."""
        held = tuple(range(len(system))) if self.particles is None else self.particles
        self._check_ids(held, system)
        places = system.state.positions[list(held)].tolist() if self.positions is None else self.positions
        box = system.box.matrix.tolist() if self.box is None and system.box.periodic else self.box
        return replace(self, particles=held, positions=places, box=box)

    def check(self, system: Subject) -> None:
        """Refuse particles that do not exist or have no mass, places out of a plane, and three stiffnesses in a leaning
        box."""
        held = self.begun(system).particles
        assert held is not None
        self._check_ids(held, system)
        check_massive(self.name, system, held)
        if np.broadcast_to(self.stiffness, 3)[2]:
            for k, place in enumerate(self.positions or ()):
                check_place_in_plane(self.name, f"positions[{k}]", place, system)
        try:
            check_alike("stiffness", self.stiffness, system)
        except InputError as error:
            raise InputError(f"{self.name}: {error}") from None

    def _check_ids(self, held: Sequence[int], system: Subject) -> None:
        n = len(system)
        if (last := max(held)) >= n:
            raise InputError(f"{self.name}: particles: there is no particle {last}; ids are 0 to {n - 1}")
        if self.positions is not None and len(self.positions) != len(held):
            raise InputError(f"{self.name}: {len(self.positions)} positions for {counted(len(held), 'particle')}")

    def fixes_box(self, system: Subject) -> str:
        """See Grouped."""
        return "" if self.scales else "its reference positions stay, so it has no virial; scales = true moves them"

    def fixes_edges(self, system: Subject) -> str:
        """See Grouped: the frame turns with the edges, and different stiffnesses have axes."""
        return "" if np.ptp(np.broadcast_to(self.stiffness, 3)) == 0 else "its stiffness has axes, and the frame turns"

    def keeps_edges(self, system: Subject) -> str:
        """See Grouped."""
        return "its reference positions are multiples of these edges"

    def places(self, system: Subject) -> tuple[Floats, Floats]:
        """Reference positions (m, 3) in the System's box, and the same as multiples of its edge vectors."""
        made, periodic = self.begun(system), np.array(system.box.periodic_axes)[:, None]
        now = np.where(periodic, system.box.matrix, np.eye(3))
        then = np.where(periodic, made.box, np.eye(3)) if self.scales and made.box else now
        fractions: Floats = np.array(made.positions, dtype=float) @ np.linalg.inv(then)
        return fractions @ now, fractions

    def apart(self, system: Subject, x: Floats) -> Floats:
        """Displacements (m, 3) of the held particles from the nearest images of their places, at positions (n, 3)."""
        made = self.begun(system)
        shifts: Floats = system.box.minimum_image(x[list(made.particles or ())] - self.places(system)[0])
        return shifts

    def bind(self, system: Subject, threads: int = 1) -> Any:
        """See Field."""
        from kickdrift.forces.fields.restraint_kernel import bind

        return bind(self.begun(system).particles, self.stiffness, self.places(system)[1], self.scales, system)


def _ids(name: str, given: Any) -> tuple[int, ...]:
    found = items(name, "particles", given)
    if not found:
        raise InputError(f"{name}: particles: expected one or more, got none")
    for k, i in enumerate(found):
        if not isinstance(i, int | np.integer) or isinstance(i, bool) or i < 0:
            raise InputError(f"{name}: particles[{k}]: expected the id of a particle, got {shown(i)}")
    if len(set(found)) < len(found):
        twice = next(i for k, i in enumerate(found) if i in found[:k])
        raise InputError(f"{name}: particles: {twice} is given twice")
    return tuple(map(int, found))
