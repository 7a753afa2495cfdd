"""Derivatives of a body's start with respect to its orbital elements and its mass, by forward differentiation.

A body's elements form a set: derivatives by one of them leave the others unchanged. The sets are a, e, inc, Omega,
omega, M with the mass, where P may stand for a and f or E for M; and Pal's a, h, k, ix, iy, lambda, which have no
singular place for circular or flat orbits (Pal 2009, doi:10.1111/j.1365-2966.2009.14853.x): h = e sin varpi, k = e cos
varpi, ix = 2 sin(inc / 2) cos Omega, iy = 2 sin(inc / 2) sin Omega, with varpi = omega + Omega and lambda = M + varpi.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from kickdrift.errors import InputError
from kickdrift.model.bodies import primary_row
from kickdrift.model.checks.limits import whole_text
from kickdrift.model.orbits import gravity_of
from kickdrift.model.starts.elements import elements
from kickdrift.model.state import Floats
from kickdrift.model.subject import index_of
from kickdrift.model.system import System
from kickdrift.text import suggestion

MASS = "mass"
SIZES, ANOMALIES = ("a", "P"), ("M", "f", "E")
PLAIN, PAL = ("e", "inc", "Omega", "omega"), ("h", "k", "ix", "iy", "lambda")
NAMES = (*SIZES, *PLAIN, *ANOMALIES, *PAL, MASS)
DEGREES = ("inc", "Omega", "omega", *ANOMALIES, "lambda")
ROUNDED = 1e-12  # a smaller eccentricity or inclination has its direction from rounding
NEWTON = 3  # steps: each doubles the order to which derivatives are right


@dataclass(frozen=True, eq=False)
class Jet:
    """A value, its gradient (k,) and its matrix of second derivatives (k, k).

    Source: Griewank & Walther 2008, Evaluating Derivatives, doi:10.1137/1.9780898717761, chapter 13.
    """

    value: float
    gradient: Floats
    hessian: Floats

    @classmethod
    def variable(cls, value: float, place: int, count: int, unit: float = 1.0) -> Jet:
        """The number ``place`` of ``count`` to differentiate by, whose own unit is ``unit``."""
        return cls(float(value), unit * np.eye(count)[place], np.zeros((count, count)))

    def through(self, value: float, slope: float, bend: float) -> Jet:
        """A function of this number, from its value and its two derivatives here."""
        outer = np.outer(self.gradient, self.gradient)
        return Jet(value, slope * self.gradient, slope * self.hessian + bend * outer)

    def __add__(self, other: Jet | float) -> Jet:
        if not isinstance(other, Jet):
            return Jet(self.value + other, self.gradient, self.hessian)
        return Jet(self.value + other.value, self.gradient + other.gradient, self.hessian + other.hessian)

    def __mul__(self, other: Jet | float) -> Jet:
        if not isinstance(other, Jet):
            return Jet(self.value * other, self.gradient * other, self.hessian * other)
        outer = np.outer(self.gradient, other.gradient)
        hessian = self.value * other.hessian + other.value * self.hessian + outer + outer.T
        return Jet(self.value * other.value, self.value * other.gradient + other.value * self.gradient, hessian)

    __radd__, __rmul__ = __add__, __mul__

    def __neg__(self) -> Jet:
        return -1.0 * self

    def __sub__(self, other: Jet | float) -> Jet:
        return self + -other

    def __rsub__(self, other: float) -> Jet:
        return -self + other

    def __pow__(self, power: float) -> Jet:
        x, p = self.value, float(power)
        return self.through(x**p, p * x ** (p - 1.0), p * (p - 1.0) * x ** (p - 2.0))

    def __truediv__(self, other: Jet | float) -> Jet:
        return self * (other**-1.0)

    def __rtruediv__(self, other: float) -> Jet:
        return other * self**-1.0


def sin(x: Jet) -> Jet:
    return x.through(math.sin(x.value), math.cos(x.value), -math.sin(x.value))


def cos(x: Jet) -> Jet:
    return x.through(math.cos(x.value), -math.sin(x.value), -math.cos(x.value))


def angle(y: Jet, x: Jet) -> Jet:
    """Angle of a point (x, y) from the x axis."""
    square = x.value**2 + y.value**2
    one, two = x.gradient, y.gradient
    gradient = (x.value * two - y.value * one) / square
    mixed = np.outer(one, two)
    twice = (x.value * one + y.value * two) / square
    hessian = (x.value * y.hessian - y.value * x.hessian + mixed - mixed.T) / square
    hessian = hessian - 2.0 * np.outer(gradient, twice)
    return Jet(math.atan2(y.value, x.value), gradient, 0.5 * (hessian + hessian.T))


class Named(NamedTuple):
    """An element of a body, such as "b.e"."""

    row: int
    key: str


class Slopes(NamedTuple):
    """Derivatives of the start: (2, 3, n, q) and (2, 3, n, q, q), and of the masses (n, q)."""

    first: Floats
    second: Floats
    masses: Floats


def named(system: System, texts: tuple[str, ...], what: str = "elements") -> tuple[Named, ...]:
    """Bodies and keys of elements given as "BODY.KEY". Raises InputError for others, and for two of different sets."""
    found = []
    for text in texts:
        body, _, key = text.rpartition(".") if isinstance(text, str) else ("", "", "")
        if not body or key not in NAMES:
            raise InputError(
                f"{what}: expected BODY.KEY with a key of {', '.join(NAMES)}, got {text!r}{suggestion(key, NAMES)}"
            )
        number = None if body in system.names else whole_text(body)
        found.append(Named(index_of(system, body if number is None else number, what), key))
    if len(set(found)) != len(found):
        raise InputError(f"{what}: expected each element once, got {', '.join(texts)}")
    for row in {each.row for each in found}:
        _basis([each.key for each in found if each.row == row], f"{what}: {system.body(row)}")
    return tuple(found)


def _basis(keys: list[str], what: str) -> tuple[str, ...]:
    """The set that these elements belong to."""

    def one(choices: tuple[str, ...]) -> str:
        chosen = [key for key in keys if key in choices]
        if len(chosen) > 1:
            raise InputError(f"{what}: {' and '.join(chosen)} belong to different sets; give one of them")
        return chosen[0] if chosen else choices[0]

    size = one(SIZES)
    plain, pal = ([key for key in keys if key in group] for group in ((*PLAIN, *ANOMALIES), PAL))
    if plain and pal:
        raise InputError(f"{what}: {plain[0]} and {pal[0]} belong to different sets; give one of them")
    return (size, *(PAL if pal else (*PLAIN, one(ANOMALIES))), MASS)


def slopes_of(system: System, names: tuple[Named, ...], primary: str | int | None = None) -> Slopes:
    """Derivatives of the start by these elements. The primary and all other bodies stay where they are.

    Raises
    ------
    InputError
        For a body that has no ellipse about its primary, and for ``e`` and ``inc`` where they have no direction.
    """
    n, count = len(system), len(names)
    first, second = np.zeros((2, 3, n, count)), np.zeros((2, 3, n, count, count))
    masses = np.zeros((n, count))
    for row in {each.row for each in names}:
        columns = [k for k, each in enumerate(names) if each.row == row]
        keys = [names[k].key for k in columns]
        state = _state(system, row, primary, keys)
        for half in range(2):
            for axis in range(3):
                jet = state[half][axis]
                first[half, axis, row, columns] = jet.gradient
                second[half, axis, row][np.ix_(columns, columns)] = jet.hessian
        masses[row, columns] = [float(key == MASS) for key in keys]
    return Slopes(first, second, masses)


def _state(system: System, row: int, primary: str | int | None, keys: list[str]) -> tuple[list[Jet], list[Jet]]:
    """Position and velocity of a body relative to its primary, with derivatives by these elements."""
    body, centre = system.body(row), primary_row(system, primary, "elements: primary")
    if row == centre:
        raise InputError(f"elements: {body} does not orbit itself; give a primary")
    G, m = gravity_of(system, "elements"), system.state.masses
    mu = G * (m[row] + m[centre])
    if not mu > 0.0:
        raise InputError(f"elements: {body} and {system.body(centre)} have no mass")
    x, v = (rows[:, row] - rows[:, centre] for rows in system.state.phase)
    orbit = elements(x, v, mu)
    if not (orbit.e < 1.0 and orbit.q > 0.0):
        raise InputError(f"elements: {body} is not on an ellipse about {system.body(centre)}: e = {float(orbit.e):.6g}")
    if "e" in keys and orbit.e < ROUNDED:
        raise InputError(f"elements: {body} is on a circle, so its pericentre has no direction; h and k take e's place")
    if "inc" in keys and 0.0 < orbit.inc < ROUNDED:
        raise InputError(f"elements: {body}'s orbit is flat, so its node has no direction; ix and iy take inc's place")
    around = float(orbit.omega + orbit.Omega)
    tilt = 2.0 * math.sin(0.5 * float(orbit.inc))
    values: dict[str, Any] = {
        "a": orbit.a, "P": orbit.period(mu), "e": orbit.e, "inc": orbit.inc, "Omega": orbit.Omega, "omega": orbit.omega,
        "M": orbit.M, "f": orbit.f, "E": orbit.E, "h": orbit.e * math.sin(around), "k": orbit.e * math.cos(around),
        "ix": tilt * math.cos(orbit.Omega), "iy": tilt * math.sin(orbit.Omega), "lambda": orbit.M + around,
        MASS: m[row],
    }  # fmt: skip

    def jet(key: str) -> Jet:
        unit = math.radians(1.0) if key in DEGREES else 1.0
        value, count = float(values[key]), len(keys)
        if key in keys:
            return Jet.variable(value, keys.index(key), count, unit)
        return Jet(value, np.zeros(count), np.zeros((count, count)))

    of = {key: jet(key) for key in _basis(keys, "elements")}
    gm = G * (of[MASS] + float(m[centre]))
    a = of["a"] if "a" in of else (gm * (of["P"] / math.tau) ** 2.0) ** (1.0 / 3.0)
    return on_ellipse(float(orbit.E) + around, gm, a, *(_pal(of) if "e" in of else (of[key] for key in PAL)))


def _pal(of: dict[str, Jet]) -> tuple[Jet, ...]:
    """Pal's h, k, ix, iy, lambda from e, inc, Omega, omega and an anomaly."""
    e, around = of["e"], of["omega"] + of["Omega"]
    if "M" in of:
        mean = of["M"]
    else:
        place = of["E"] if "E" in of else _eccentric(of["f"], e)
        mean = place - e * sin(place)
    tilt = 2.0 * sin(0.5 * of["inc"])
    return e * sin(around), e * cos(around), tilt * cos(of["Omega"]), tilt * sin(of["Omega"]), mean + around


def _eccentric(f: Jet, e: Jet) -> Jet:
    """Eccentric anomaly from the true anomaly."""
    return angle((1.0 - e * e) ** 0.5 * sin(f), e + cos(f))


def on_ellipse(
    near: float, gm: Jet, a: Jet, h: Jet, k: Jet, ix: Jet, iy: Jet, longitude: Jet
) -> tuple[list[Jet], list[Jet]]:
    """Position and velocity from Pal's elements (Broucke & Cefola 1972, doi:10.1007/BF01228432, with Pal's ix and iy).

    The eccentric longitude F solves F - k sin F + h cos F = lambda; ``near`` is its value.
    """
    at = 0.0 * longitude + near
    for _ in range(NEWTON):
        at = at - (at - k * sin(at) + h * cos(at) - longitude) / (1.0 - k * cos(at) - h * sin(at))
    c, s = cos(at), sin(at)
    beta = 1.0 / (1.0 + (1.0 - h * h - k * k) ** 0.5)
    r, motion = a * (1.0 - k * c - h * s), (gm * a) ** 0.5
    mixed, over_k, over_h = h * k * beta, 1.0 - k * k * beta, 1.0 - h * h * beta
    plane = a * (over_h * c + mixed * s - k), a * (over_k * s + mixed * c - h)
    speed = motion / r * (mixed * c - over_h * s), motion / r * (over_k * c - mixed * s)
    iz = (4.0 - ix * ix - iy * iy) ** 0.5

    def in_space(x: Jet, y: Jet) -> list[Jet]:
        w = ix * y - iy * x
        return [x + 0.5 * iy * w, y - 0.5 * ix * w, 0.5 * iz * w]

    return in_space(*plane), in_space(*speed)
