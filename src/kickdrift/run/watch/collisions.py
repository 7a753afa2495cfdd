"""Changes of a system by collisions and escapes: bodies merge, bounce, break up, come or leave with their energy."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from kickdrift.errors import InputError, RunError
from kickdrift.forces.fields.shipped import Hill
from kickdrift.looks.observers import Sample, Taken, angular_momentum, kinetic_energy
from kickdrift.model.changing import holding, remaining
from kickdrift.model.events.collision import Collision, Sphere, material_of, ratio, restitution_of
from kickdrift.model.events.events import Escape, binding
from kickdrift.model.memory import Memory
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.run.watch.fragments import Material, fragmented
from kickdrift.text import shown

EXACT = 1e-10  # error of mass and momentum that rounding in a user's rule may make
BY_RULE = "rule"


class Outcome(NamedTuple):
    """Bodies after a collision, and its regime. A body with the name of one of the two is that body."""

    bodies: list[Sphere]
    regime: str


def outcome(event: Collision, system: System, y: Floats, pair: tuple[int, int], radii: Floats) -> Outcome:
    """Bodies after the collision of the rows ``pair``, the heavier first, at y (2, 3, n). ``radii`` (n,) are the
    event's.

    Raises RunError for a rule that fails, or returns what no collision can."""
    heavier, lighter = (sphere_of(system, y, i, radii) for i in pair)
    if event.action == "fragment":
        material, smallest = material_in(event, system), event.fragment_mass
        assert smallest is not None
        found = fragmented(heavier, lighter, material, smallest)
        return Outcome(found.bodies, found.regime)
    return Outcome(_ruled(event, system, heavier, lighter), BY_RULE)


def sphere_of(system: System, y: Floats, i: int, radii: Floats) -> Sphere:
    """The body of a row."""
    return Sphere(float(system.state.masses[i]), y[0, :, i].copy(), y[1, :, i].copy(), float(radii[i]), system.body(i))


def material_in(event: Collision, system: System) -> Material:
    """Constants of the scaling laws in a system's units."""
    return Material(*material_of(event, system, binding(system)))


def _ruled(event: Collision, system: System, heavier: Sphere, lighter: Sphere) -> list[Sphere]:
    """Bodies that the user's rule returns, checked."""
    try:
        given = event.rule(heavier, lighter)  # type: ignore[misc]
    except Exception as error:  # whatever a user's function raises
        raise RunError(" ".join(f"raised {type(error).__name__}: {error}".split())) from error
    bodies = _listed(given)
    for k, body in enumerate(bodies):
        if problem := body.problem():
            raise RunError(f"returned body {k} with {problem}")
    made = [
        Sphere(float(b.mass), np.array(b.position, float), np.array(b.velocity, float), float(b.radius), b.name)
        for b in bodies
    ]
    _check_names(system, made, (heavier.name, lighter.name))
    if system.dimensions == 2 and any(b.velocity[2] or b.position[2] != heavier.position[2] for b in made):
        raise RunError("returned a body outside the plane of the system")
    _check_totals(event, made, (heavier, lighter))
    return made


def _listed(given: Any) -> list[Sphere]:
    bodies = list(given) if isinstance(given, Sequence) and not isinstance(given, Sphere | str) else None
    if bodies is None or not all(isinstance(body, Sphere) for body in bodies):
        raise RunError(f"returned {shown(given)}; expected a list of kd.Sphere")
    return bodies


def _check_names(system: System, bodies: list[Sphere], pair: tuple[str, str]) -> None:
    seen: set[str] = set()
    for name in (body.name for body in bodies if body.name):
        if name in seen:
            raise RunError(f"returned two bodies with the name {shown(name)}")
        if name not in pair and (name in system.names or not system.names):
            what = "the name of another body" if system.names else "a name, and the bodies of the system have no names"
            raise RunError(f"returned a body with the name {shown(name)}: that is {what}")
        seen.add(name)


def _check_totals(event: Collision, after: list[Sphere], before: tuple[Sphere, Sphere]) -> None:
    """Refuse bodies of another mass or momentum than the two had."""
    mass, was = (sum(body.mass for body in bodies) for bodies in (after, before))
    if mass > was * (1 + EXACT) or (mass < was * (1 - EXACT) and not event.loss):
        hint = "" if mass > was else "; loss = true allows less mass"
        raise RunError(f"returned the mass {mass:.9g} of {was:.9g}{hint}")
    error, scale = momentum_error(after, before)
    if error > EXACT * scale and not event.loss:
        raise RunError(f"changed the momentum by {error / scale:.2g} of the sum of m |v|")


def momentum_error(after: Sequence[Sphere], before: Sequence[Sphere]) -> tuple[float, float]:
    """Change of the momentum, and the sum of m |v|, in which rounding errors are measured."""
    zero = np.zeros(3)
    change = sum((body.momentum for body in after), zero) - sum((body.momentum for body in before), zero)
    scale = max(sum(float(np.linalg.norm(body.momentum)) for body in bodies) for bodies in (after, before))
    return float(np.linalg.norm(change)), scale or 1.0


def told(found: Outcome, before: Sequence[Sphere]) -> str:
    """Text for the log: regime, masses, and the error of the momentum."""
    masses = [f"{body.mass:.6g}" for body in found.bodies]
    each = [f"{masses.count(m)} x {m}" if masses.count(m) > 1 else m for m in dict.fromkeys(masses)]
    error, scale = momentum_error(found.bodies, before)
    left = f"mass{'es' * (len(masses) > 1)} {', '.join(each)}" if masses else "no body left"
    return f"{found.regime}: {left}; momentum error {error / scale:.1e}"


class New(NamedTuple):
    """The next new body: its id, and its number in the run, from 1."""

    id: int
    number: int


@dataclass(frozen=True)
class Change:
    """Result of an event that acts on bodies.

    Attributes
    ----------
    system, y : the bodies now
    done : text for the log
    gone : rows of the bodies that left
    survivor : row of the body that absorbed them, or None
    sizes : new radii by row; None if the survivor takes the volumes of the others
    born : radii of the new bodies, which are the last rows now
    """

    system: System
    y: Floats
    done: str
    gone: tuple[int, ...] = ()
    survivor: int | None = None
    sizes: dict[int, float] | None = None
    born: list[float] = field(default_factory=list)

    @property
    def other_bodies(self) -> bool:
        """Whether the system has other bodies, or other masses, than before."""
        return bool(self.gone or self.born or self.sizes)

    def radii(self, radii: Floats) -> Floats:
        """Radii of the bodies now, from those (n,) before."""
        if self.sizes is None and self.survivor is not None:
            for each in self.gone:
                radii = joined(radii, self.survivor, each)
        elif self.sizes:
            radii = radii.copy()
            radii[list(self.sizes)] = list(self.sizes.values())
        return np.concatenate([np.delete(radii, list(self.gone)), self.born])


def changed(
    event: Collision | Escape,
    system: System,
    y: Floats,
    bodies: tuple[int, ...],
    radii: Floats,
    new: New,
    offset: Floats | float = 0.0,
) -> Change:
    """Act on the bodies at y. ``radii`` (n,) are the event's, and ``new`` says which new body comes next. The first of
    two bodies meets the image of the second at the ``offset`` (2, 3): all but bounces leave the result there.

    Raises RunError for a rule that fails."""
    if isinstance(event, Escape):
        (gone,) = bodies
        return Change(*without(system, y, gone), "removed", (gone,))
    i, j = bodies
    masses = system.state.masses
    if event.action == "bounce":
        restitution = ratio(restitution_of(event, system), approach_speed(y, i, j, offset))
        return Change(system, bounced(masses, y, i, j, restitution, offset), "bounced")
    y = y.copy()
    y[:, :, j] += offset
    pair = (i, j) if masses[i] >= masses[j] else (j, i)
    if event.action == "merge":
        survivor, gone = pair
        done = f"{system.body(gone)} merged into {system.body(survivor)}"
        return Change(*merged(system, y, survivor, gone), done, (gone,), survivor)
    before = [sphere_of(system, y, k, radii) for k in pair]
    found = outcome(event, system, y, pair, radii)
    return replaced(system, y, pair, found, told(found, before), new)


def without(system: System, y: Floats, gone: int) -> tuple[System, Floats]:
    """Return the system and y (2, 3, n) without one body."""
    left = remaining(system, np.arange(len(system)) != gone, y, system.state.masses, system.radii)
    return left, left.state.phase.copy()


def replaced(system: System, y: Floats, pair: tuple[int, int], found: Outcome, done: str, come: New) -> Change:
    """Put the bodies of an outcome in the place of two rows. New bodies come last, with the species of the heavier
    body, the ids from ``come`` on, and its name with a number."""
    state, row_of = system.state, {system.body(i): i for i in pair}
    kept = {row_of[body.name]: body for body in found.bodies if body.name in row_of}
    new = [body for body in found.bodies if body.name not in row_of]
    gone = tuple(i for i in pair if i not in kept)
    y, masses = y.copy(), state.masses.copy()
    for row, body in kept.items():
        y[0, :, row], y[1, :, row], masses[row] = body.position, body.velocity, body.mass
    sizes = {row: body.radius for row, body in kept.items()}
    change = Change(system, y, done, gone, next((i for i in pair if i in kept), None), sizes, [b.radius for b in new])
    stay = np.delete(np.arange(len(system)), list(gone))
    if not len(stay) + len(new):
        raise RunError("left no body in the run")
    places = np.array([[body.position, body.velocity] for body in new]).reshape(-1, 2, 3).transpose(1, 2, 0)
    names = _named(system, system.body(pair[0]), new, come.number)
    other = holding(
        system,
        np.concatenate([state.ids[stay], come.id + np.arange(len(new), dtype=np.int64)]),
        np.concatenate([y[:, :, stay], places], axis=2),
        np.concatenate([masses[stay], [body.mass for body in new]]),
        None if system.radii is None else change.radii(system.radii),
        np.concatenate([system.species_index[stay], np.full(len(new), system.species_index[pair[0]])]),
        [*(system.names[i] for i in stay), *names] if system.names else (),
    )
    return Change(other, other.state.phase.copy(), done, gone, change.survivor, sizes, change.born)


def _named(system: System, parent: str, new: Sequence[Sphere], number: int) -> list[str]:
    """Names of new bodies: their own, or the parent's with the number of the new body in the run. So no name comes
    twice, and a fragment of a fragment has its first parent's name."""
    first, taken, names = parent.partition("/fragment-")[0], {*system.names, *(body.name for body in new)}, []
    for k, body in enumerate(new):
        name = body.name or f"{first}/fragment-{number + k}"
        names.append(name if body.name or name not in taken else f"{name}-new")
    return names


def approach_speed(y: Floats, i: int, j: int, offset: Floats | float = 0.0) -> float:
    """Speed at which a body and another one's image approach along the line of centres."""
    x, v = y[:, :, i] - y[:, :, j] - offset
    return -float(x @ v) / float(np.linalg.norm(x))


def merged(system: System, y: Floats, survivor: int, absorbed: int) -> tuple[System, Floats]:
    """Return the system and y with two bodies merged, at the survivor's index.

    Mass, momentum, centre of mass and volume are conserved.
    """
    masses, y = system.state.masses.copy(), y.copy()
    pair = [survivor, absorbed]
    total = masses[pair].sum()
    # The heavier body's own place and a small change: both may lie far from the origin.
    y[:, :, survivor] += masses[absorbed] / total * (y[:, :, absorbed] - y[:, :, survivor])
    masses[survivor] = total
    radii = None if system.radii is None else joined(system.radii, survivor, absorbed)
    left = remaining(system, np.arange(len(system)) != absorbed, y, masses, radii)
    return left, left.state.phase.copy()


def joined(radii: Floats, survivor: int, absorbed: int) -> Floats:
    """Copy of radii (n,) in which the survivor has taken the other body's volume. The other radius stays in the
    array."""
    radii = radii.copy()
    radii[survivor] = np.cbrt(radii[survivor] ** 3 + radii[absorbed] ** 3)
    return radii


def bounced(masses: Floats, y: Floats, i: int, j: int, restitution: float, offset: Floats | float = 0.0) -> Floats:
    """Copy of y (2, 3, n) after the bounce of two hard spheres. The second sphere is an image at the ``offset``.

    The normal part of their relative velocity is reversed and multiplied by ``restitution``. Momentum is conserved.
    """
    y = y.copy()
    normal, velocity = y[:, :, i] - y[:, :, j] - offset
    normal /= np.linalg.norm(normal)
    speed = float(velocity @ normal)
    impulse = -(1.0 + restitution) * speed / (masses[i] + masses[j])  # divided by m_i m_j
    y[1, :, i] += impulse * masses[j] * normal
    y[1, :, j] -= impulse * masses[i] * normal
    return y


def bodies_memory(first: Any, system: Any) -> Memory | None:
    """Bodies of a system, and their start; None if these are still those of ``first``."""
    if system is first:
        return None
    state = system.state
    return {
        "ids": state.ids,
        "masses": state.masses,
        "radii": system.radii,
        "phase": state.phase,
        "names": list(system.names),
        "species": system.species_index,
    }


def system_with(first: System, memory: Memory) -> System:
    """System with the bodies of a memory; the inverse of ``bodies_memory``.

    Memories of version 0.1.0 hold no names and species: no bodies were new then."""
    ids, known = memory["ids"], np.isin(memory["ids"], first.state.ids)
    if "names" not in memory:
        if not known.all():
            raise InputError("checkpoint: some of its bodies are missing in the system")
        keep = np.isin(first.state.ids, ids)
        memory = memory | {
            "names": [name for name, kept in zip(first.names, keep, strict=False) if kept],
            "species": first.species_index[keep],
        }
    n, species = len(ids), np.asarray(memory["species"], np.int32)
    shapes = {"masses": (n,), "phase": (2, 3, n), **({} if memory["radii"] is None else {"radii": (n,)})}
    if any(np.shape(memory[key]) != shape for key, shape in shapes.items()) or species.shape != (n,):
        raise InputError("checkpoint: its bodies do not fit together")
    if len(memory["names"]) != (n if first.names else 0) or len(np.unique(ids)) != n or not n:
        raise InputError("checkpoint: its bodies do not fit together")
    if species.min() < 0 or species.max() >= len(first.species):
        raise InputError("checkpoint: its bodies are of unknown species")
    return holding(
        first, np.array(ids, np.int64), memory["phase"].copy(), memory["masses"].copy(),
        None if memory["radii"] is None else memory["radii"].copy(), species, memory["names"],
    )  # fmt: skip


def taken_between(before: Sample, after: Sample) -> Taken:
    """The difference of two samples, just before and just after an event."""
    return Taken(
        before.energies.total - after.energies.total,
        _lost(before.momentum, after.momentum),
        _lost(before.angular_momentum, after.angular_momentum),
    )


def energy_of_places(system: System) -> bool:
    """Tell whether the potential energy is known to depend on positions and time alone. A bounce then changes nothing
    but the velocities of two bodies, and needs no forces."""
    return all(not getattr(force, "velocity_dependent", False) or isinstance(force, Hill) for force in system.forces)


def taken_by_bounce(system: System, before: Floats, after: Floats, bodies: tuple[int, ...]) -> Taken:
    """Losses of the two bodies of a bounce, whose velocities alone differ between two states (2, 3, n)."""
    rows = list(bodies)
    m, x = system.coherent_masses[rows], before[0][:, rows]
    v, u = before[1][:, rows], after[1][:, rows]
    return Taken(kinetic_energy(m, v) - kinetic_energy(m, u), (v - u) @ m, angular_momentum(m, x, v - u))


def _lost(before: Floats | None, after: Floats | None) -> Floats | float:
    return np.zeros(3) if before is None or after is None else before - after
