"""Kepler's elements from states and states from elements, on every conic.

The pericentre distance q and the eccentricity e give the shape of an orbit: an ellipse (e < 1), a parabola (e = 1) or
a hyperbola (e > 1). The semi-major axis a = q / (1 - e) is negative on a hyperbola and infinite on a parabola. The
inclination inc, the longitude of the ascending node Omega and the argument of pericentre omega give the orientation of
the orbit. The true anomaly f gives the body's place on it. Angles are in radians here (system files have degrees).

An undefined angle is zero: Omega if inc is 0 or pi, omega if e = 0. The other angles then count from the x axis, or
from the node, so that elements give back the same state.

Source: Murray & Dermott 1999, Solar System Dynamics, ch. 2, doi:10.1017/CBO9781139174817.

Kepler's equation is solved on every conic in the universal variable s. On an ellipse s is E / sqrt(1 - e), on a
hyperbola H / sqrt(e - 1), and on a parabola their common limit, 2 tan(f / 2) / sqrt(1 + e). Lengths are in pericentre
distances q, times in sqrt(q^3 / mu). Source: Danby 1988, Fundamentals of Celestial Mechanics, 6.9.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kickdrift.errors import InputError
from kickdrift.model.checks.values import numbers
from kickdrift.model.state import Floats

TAU = 2 * math.pi
MOST_ITERATIONS = 100  # Newton's method, from the right of a convex function, needs 5 to 15
CLOSED_FORM = 1.0  # least |z| for the closed forms of Stumpff's functions; below it their series are exact


def stumpff(z: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Stumpff's functions c0, c1, c2, c3 of z (Danby 1988, 6.9).

    For x^2 = z > 0 they are cos x, sin x / x, (1 - cos x) / x^2 and (x - sin x) / x^3; for z < 0 sinh and cosh replace
    sin and cos.
    """
    z = np.asarray(z, dtype=float)
    near = np.abs(z) < CLOSED_FORM
    small = np.where(near, z, 0.0)
    c2s, c3s = np.zeros_like(z), np.zeros_like(z)
    for k in range(9, -1, -1):  # 1/20! is 4e-19
        c2s = 1.0 / math.factorial(2 * k + 2) - small * c2s
        c3s = 1.0 / math.factorial(2 * k + 3) - small * c3s
    x = np.sqrt(np.where(near, 1.0, np.abs(z)))
    up = z > 0
    swing = np.where(up, np.sin(x), np.sinh(np.where(up, 0.0, x)))
    # 1 - cos x and cosh x - 1 as squares of the half angle: no cancellation
    half = np.where(up, np.sin(x / 2), np.sinh(np.where(up, 0.0, x / 2)))
    c2 = np.where(near, c2s, 2.0 * half**2 / x**2)
    c3 = np.where(near, c3s, np.where(up, x - swing, swing - x) / x**3)
    return 1.0 - z * c2, 1.0 - z * c3, c2, c3


def kepler_time(e: Floats, s: Floats) -> Floats:
    """Time since the pericentre, in sqrt(q^3 / mu), at the universal variable s: Kepler's equation of all conics."""
    return s + e * s**3 * stumpff((1.0 - e) * s * s)[3]


def universal_anomaly(e: Floats, f: ArrayLike) -> Floats:
    """Universal variable s at the true anomaly f in (-pi, pi]."""
    f = np.asarray(f, dtype=float)
    alpha = 1.0 - e
    root = np.sqrt(np.abs(alpha))
    up, down = alpha > 0, alpha < 0
    ellipse = 2.0 * np.arctan2(root * np.sin(f / 2), np.sqrt(1.0 + e) * np.cos(f / 2))
    with np.errstate(divide="ignore", invalid="ignore"):
        k = np.tan(f / 2) / np.sqrt(1.0 + e)
        hyperbola = 2.0 * np.arctanh(np.where(down, root * k, 0.0))
        return np.where(up, ellipse / root, np.where(down, hyperbola / root, 2.0 * k))


def anomaly_at(time: Floats, e: Floats) -> Floats:
    """Solve kepler_time(e, s) = time for s; |time| is at most half a period.

    kepler_time is odd. For s > 0, up to half a period, it rises (its slope is r / q >= 1) and is convex (its curvature
    is e times s c1 >= 0), so Newton's iteration from above converges to the root. Two upper bounds of s start it. A
    cubic equation comes from c3 >= 1 / pi^2 on this half of an ellipse and c3 >= 1 / 6 on a hyperbola. The other bound
    is e sinh H - H >= (e - 1) sinh H.
    """
    alpha = 1.0 - e
    tau = np.abs(time)
    third = 3.0 * e * np.where(alpha > 0, 1.0 / math.pi**2, 1.0 / 6.0)  # s + third / 3 s^3 <= tau
    root = np.sqrt(np.where(alpha == 0, 1.0, np.abs(alpha)))
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        deep = np.sqrt(third)
        cubic = 2.0 / deep * np.sinh(np.arcsinh(1.5 * deep * tau) / 3.0)
        bound = np.where(deep * tau > 1e-8, cubic, tau)
    bound = np.minimum(bound, tau)
    bound = np.where(alpha > 0, np.minimum(bound, math.pi / root), bound)
    bound = np.where(alpha < 0, np.minimum(bound, np.arcsinh(tau * root) / root), bound)
    s = bound * (1.0 + 4e-16)
    for _ in range(MOST_ITERATIONS):
        _, _, c2, c3 = stumpff(alpha * s * s)
        step = (s + e * s**3 * c3 - tau) / (1.0 + e * s * s * c2)
        s = s - step
        if np.all(np.abs(step) <= 4e-16 * s):
            break
    return np.copysign(s, time)


ANGLES = ("inc", "Omega", "omega", "f", "M", "E")


class Elements(NamedTuple):
    """Orbits: each field is a number or an array, all of one shape; angles are in radians.

    From states ``inc`` is in [0, pi], ``Omega`` and ``omega`` are in [0, 2 pi), and ``f`` is in (-pi, pi].
    """

    q: Floats
    e: Floats
    inc: Floats
    Omega: Floats
    omega: Floats
    f: Floats

    @property
    def a(self) -> Floats:
        """Semi-major axis q / (1 - e): negative on a hyperbola, infinite on a parabola."""
        with np.errstate(divide="ignore"):
            return np.asarray(self.q / (1.0 - np.asarray(self.e)))

    @property
    def E(self) -> Floats:
        """Eccentric anomaly; on a hyperbola H, with e sinh H - H the mean anomaly; nan on a parabola."""
        e = np.asarray(self.e, dtype=float)
        return np.where(e == 1.0, np.nan, universal_anomaly(e, self.f) * np.sqrt(np.abs(1.0 - e)))

    @property
    def M(self) -> Floats:
        """Mean anomaly E - e sin E, or e sinh H - H; nan on a parabola."""
        e = np.asarray(self.e, dtype=float)
        return np.where(e == 1.0, np.nan, kepler_time(e, universal_anomaly(e, self.f)) * np.abs(1.0 - e) ** 1.5)

    def since_pericentre(self, mu: ArrayLike) -> Floats:
        """Time since the nearest passage of the pericentre; ``mu`` is G times the two masses."""
        e = np.asarray(self.e, dtype=float)
        return np.asarray(
            kepler_time(e, universal_anomaly(e, self.f))
            * np.sqrt(np.asarray(self.q) ** 3 / np.asarray(mu, dtype=float))
        )

    def period(self, mu: ArrayLike) -> Floats:
        """Period 2 pi sqrt(a^3 / mu); infinite for an open orbit."""
        a = self.a
        closed = (a > 0) & np.isfinite(a)
        return np.where(closed, TAU * np.sqrt(np.where(closed, a, 1.0) ** 3 / np.asarray(mu, dtype=float)), np.inf)


def states(
    mu: ArrayLike,
    *,
    e: ArrayLike,
    a: ArrayLike | None = None,
    q: ArrayLike | None = None,
    inc: ArrayLike = 0.0,
    Omega: ArrayLike = 0.0,
    omega: ArrayLike = 0.0,
    f: ArrayLike | None = None,
    M: ArrayLike | None = None,
    E: ArrayLike | None = None,
    T: ArrayLike | None = None,
    t: ArrayLike = 0.0,
) -> tuple[Floats, Floats]:
    """Positions and velocities (…, 3) relative to the centre, of bodies on orbits with these elements.

    Arguments are numbers or arrays, broadcast together. For a time T the state's error is within 3.4 eps of its size on
    every conic, measured against 50 digits for e from 0 to 30 up to half a period, or 1000 sqrt(q^3/mu).

    Parameters
    ----------
    mu : G times the masses of centre and body
    e : eccentricity, zero or more
    a, q : one of the semi-major axis (negative on a hyperbola) and the pericentre distance (any conic)
    inc, Omega, omega : radians
    f, M, E, T : at most one of the true, mean and eccentric anomaly (radians; on a hyperbola M = e sinh H - H and E
        stands for H) and the time of pericentre passage; default the pericentre
    t : time of the state, for T

    Raises
    ------
    InputError
        For values that are not an orbit. The message names the element and, among several bodies, the body.
    """
    one = [name for name, value in (("f", f), ("M", M), ("E", E), ("T", T)) if value is not None]
    if len(one) > 1:
        raise InputError(f"expected one of f, M, E, T, got {' and '.join(one)}")
    if (a is None) == (q is None):
        raise InputError(f"expected exactly one of a, q, got {'none' if a is None else 'a and q'}")
    kind, where = (one or ["f"])[0], [value for value in (f, M, E, T) if value is not None]
    size = "a" if q is None else "q"
    given: dict[str, Any] = {"mu": mu, size: a if q is None else q, "e": e, "inc": inc, "Omega": Omega, "omega": omega,
             kind: where[0] if where else 0.0, "t": t}  # fmt: skip
    try:
        arrays = np.broadcast_arrays(
            *[numbers("elements", value, f"numbers, {name} among them") for name, value in given.items()]
        )
    except InputError:
        raise
    except (TypeError, ValueError) as error:
        raise InputError(f"elements: expected numbers, or arrays of one shape: {error}") from None
    value = dict(zip(given, arrays, strict=True))
    for name, array in value.items():
        _refuse(~np.isfinite(array), name, array, "expected a finite number")
    mu_, e_ = value["mu"], value["e"]
    _refuse(mu_ <= 0, "mu", mu_, "expected a positive number, G times the masses")
    _refuse(e_ < 0, "e", e_, "expected an eccentricity, zero or more")
    q_ = _pericentre(value[size], e_, size)
    x, y, u, w = _in_plane(mu_, q_, e_, kind, value[kind], value["t"])
    return _in_space(x, y, value), _in_space(u, w, value)


def elements(positions: ArrayLike, velocities: ArrayLike, mu: ArrayLike) -> Elements:
    """Elements (…) of bodies at positions and velocities (…, 3) relative to the centre.

    A body that moves straight to or from the centre has no orbital plane, so its e is 1, its q 0 and its angles nan.
    Parameters
    ----------
    mu : G times the masses of centre and body; a number or (…)
    """
    x, v = numbers("positions", positions), numbers("velocities", velocities)
    mu_ = numbers("mu", mu)
    if x.shape != v.shape or x.shape[-1:] != (3,) or mu_.shape not in ((), x.shape[:-1], x.shape[-2:-1]):
        raise InputError(
            f"elements: expected positions and velocities (…, 3) and mu, a number or (…), got shapes {x.shape}, "
            f"{v.shape} and {mu_.shape}"
        )
    _refuse(~(mu_ > 0), "mu", mu_, "expected a positive number, G times the masses")
    r = np.linalg.norm(x, axis=-1)
    _refuse(r == 0, "position", r, "the body is at the centre")
    h = np.cross(x, v)
    hh = np.linalg.norm(h, axis=-1)
    # e points to the pericentre: v x h / mu - x / r (Murray & Dermott 2.8, there in components).
    towards = np.cross(v, h) / mu_[..., None] - x / r[..., None]
    e = np.linalg.norm(towards, axis=-1)
    straight = hh == 0
    e = np.where(straight, 1.0, e)
    q = hh**2 / mu_ / (1.0 + e)
    flat = np.hypot(h[..., 0], h[..., 1])
    inc = np.arctan2(flat, h[..., 2])
    Omega = np.where(flat > 0, np.arctan2(h[..., 0], -h[..., 1]), 0.0)
    node = np.stack([np.cos(Omega), np.sin(Omega), np.zeros_like(Omega)], axis=-1)
    ahead = np.cross(h / np.where(straight, 1.0, hh)[..., None], node)
    # Both angles are measured from the node in the same way. So omega + f is accurate even for an e so small that the
    # direction of the pericentre is noise.
    omega = np.where(e > 0, np.arctan2(_dot(towards, ahead), _dot(towards, node)), 0.0)
    f = np.arctan2(_dot(x, ahead), _dot(x, node)) - omega
    f -= TAU * np.ceil(f / TAU - 0.5)
    missing = np.where(straight, np.nan, 0.0)
    return Elements(q, e, inc + missing, Omega % TAU + missing, omega % TAU + missing, f + missing)


# -- the plane of the orbit


def _in_plane(
    mu: Floats, q: Floats, e: Floats, kind: str, value: Floats, t: Floats
) -> tuple[Floats, Floats, Floats, Floats]:
    """Position and velocity along the direction of the pericentre, and 90 degrees ahead."""
    speed = np.sqrt(mu / q)
    parabola = e == 1.0
    if kind == "f":
        reach = 1.0 + e * np.cos(value)
        beyond = (reach <= 0) | ((e >= 1) & (np.abs(value - TAU * np.round(value / TAU)) >= _asymptote(e)))
        _refuse(beyond, "f", value, "a hyperbola or parabola ends at its asymptote, cos f = -1 / e, before that")
        r = q * (1.0 + e) / reach
        along = speed / np.sqrt(1.0 + e)
        return r * np.cos(value), r * np.sin(value), -along * np.sin(value), along * (e + np.cos(value))
    if kind in "ME":
        _refuse(parabola, kind, value, "a parabola has no mean or eccentric anomaly; expected f or T")
    alpha = 1.0 - e
    root = np.sqrt(np.where(parabola, 1.0, np.abs(alpha)))
    if kind == "E":
        s = value / root
    else:
        lapse = (t - value) * speed / q if kind == "T" else value / root**3
        turn = TAU / root**3
        s = anomaly_at(lapse - np.where(alpha > 0, np.round(lapse / turn) * turn, 0.0), e)
    c0, c1, c2, _ = stumpff(alpha * s * s)
    r = 1.0 + e * s * s * c2  # in units of q
    wide = np.sqrt(1.0 + e)
    return q * (1.0 - s * s * c2), q * wide * s * c1, -speed * s * c1 / r, speed * wide * c0 / r


# -- helpers


def _pericentre(size: Floats, e: Floats, name: str) -> Floats:
    if name == "q":
        _refuse(size <= 0, "q", size, "expected a positive pericentre distance")
        return size
    _refuse(e == 1.0, "e", e, "a parabola (e = 1) has no semi-major axis; give its pericentre distance q instead of a")
    _refuse((e < 1) & (size <= 0), "a", size, "an ellipse (e < 1) has a positive semi-major axis")
    _refuse((e > 1) & (size >= 0), "a", size, "a hyperbola (e > 1) has a negative semi-major axis")
    return size * (1.0 - e)


def _asymptote(e: Floats) -> Floats:
    return np.arccos(-1.0 / np.maximum(e, 1.0))


def _in_space(x: Floats, y: Floats, angles: dict[str, Floats]) -> Floats:
    """Vectors (…, 3) in space, from components in the plane of the orbit (Murray & Dermott 2.121)."""
    co, so = np.cos(angles["omega"]), np.sin(angles["omega"])
    cn, sn = np.cos(angles["Omega"]), np.sin(angles["Omega"])
    ci, si = np.cos(angles["inc"]), np.sin(angles["inc"])
    along, ahead = x * co - y * so, x * so + y * co
    return np.stack([along * cn - ahead * sn * ci, along * sn + ahead * cn * ci, ahead * si], axis=-1)


def _dot(a: Floats, b: Floats) -> Floats:
    return np.einsum("...k,...k->...", a, b)


def _refuse(bad: NDArray[np.bool_], name: str, values: Floats, why: str) -> None:
    """Raise an InputError about the first bad value, with its index among several."""
    if np.any(bad):
        place = np.argwhere(np.atleast_1d(bad))[0]
        which = f" of body {', '.join(map(str, place))}" if np.ndim(values) and np.size(values) > 1 else ""
        value = float(np.atleast_1d(values)[tuple(place)])
        angle = f" rad ({math.degrees(value):.9g} deg)" if name in ANGLES and math.isfinite(value) else ""
        raise InputError(f"{name}{which}: {why}, got {value!r}{angle}")
