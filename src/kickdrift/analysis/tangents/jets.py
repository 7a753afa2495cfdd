"""A number with its first and second derivatives: forward differentiation to second order in plain Python."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from kickdrift.model.state import Floats


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
