"""Parts of a galaxy: kinds of potentials with their parameters, the Milky Way, and strengths that are formulas of t."""

from __future__ import annotations

import ast
import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from kickdrift.errors import InputError
from kickdrift.forces.formulas.expression import formula_of, value_of
from kickdrift.forces.seam.arguments import number
from kickdrift.text import choices, shown, suggestion

POSITIVE, NOT_NEGATIVE, ANY = "positive", "zero or more", ""
TURNS = {"angle": (ANY, 0.0), "omega": (ANY, 0.0)}


class Kind(NamedTuple):
    """A kind of potential: its parameters with what each must be and its default, and why its mass is infinite."""

    takes: Mapping[str, tuple[str, float | None]]
    infinite: str = ""


MASS, LENGTH = (POSITIVE, None), (POSITIVE, None)
KINDS: dict[str, Kind] = {
    "kepler": Kind({"mass": MASS}),
    "plummer": Kind({"mass": MASS, "b": LENGTH}),
    "isochrone": Kind({"mass": MASS, "b": LENGTH}),
    "hernquist": Kind({"mass": MASS, "a": LENGTH}),
    "nfw": Kind({"mass": MASS, "a": LENGTH}, "grows as log(r)"),
    "miyamoto-nagai": Kind({"mass": MASS, "a": (NOT_NEGATIVE, None), "b": LENGTH}),
    "power-law": Kind({"mass": MASS, "alpha": (NOT_NEGATIVE, None), "cutoff": LENGTH}),
    "logarithmic": Kind(
        {"speed": MASS, "core": (NOT_NEGATIVE, 0.0), "q": (POSITIVE, 1.0), "p": (POSITIVE, 1.0), **TURNS}, "grows as r"
    ),
    "bar": Kind({"mass": MASS, "a": LENGTH, "b": (NOT_NEGATIVE, None), "c": LENGTH, **TURNS}),
}
CODES = {kind: code for code, kind in enumerate(KINDS)}
COMMON = ("kind", "strength")
MILKY_WAY = "MWPotential2014"
PARTS = {"power-law": 0.05, "miyamoto-nagai": 0.6, "nfw": 0.35}  # of the centre's pull on the Sun's circle
# A strength is a program for a stack of numbers: a constant, the time, an operation on the last one or two or three.
OPERATIONS = (
    "number", "t", "neg", "Add", "Sub", "Mult", "Div", "Pow", "sqrt", "exp", "log", "sin", "cos", "tan", "sec", "csc",
    "cot", "sinh", "cosh", "tanh", "square", "cube", "recip", "abs", "step", "min", "max", "select",
)  # fmt: skip


def checked_part(where: str, given: Any) -> Any:
    """A checked part: a table of numbers, or the name MWPotential2014."""
    if isinstance(given, str):
        if given != MILKY_WAY:
            known = (MILKY_WAY, *KINDS)
            hint = suggestion(given, known)
            if given in KINDS:
                hint = f'; a kind needs its parameters: {{ kind = "{given}", {_keys(given)} }}'
            raise InputError(f"{where}: expected {MILKY_WAY!r} or a table, got {shown(given)}{hint}")
        return given
    if not isinstance(given, Mapping):
        raise InputError(f"{where}: expected a table with a kind, got {shown(given)}")
    kind = given.get("kind")
    if kind not in KINDS:
        raise InputError(f"{where}.kind: expected one of {choices(KINDS, kind)}, got {shown(kind)}")
    takes, found = KINDS[kind].takes, {"kind": kind}
    for key in given:
        if key not in takes and key not in COMMON:
            hint = suggestion(str(key), takes) or f"; {kind} has {', '.join(takes)} and strength"
            raise InputError(f"{where}: {kind} has no {shown(key)}{hint}")
    for key, (sign, default) in takes.items():
        if key not in given:
            if default is None:
                more = "; without a cutoff its mass is infinite" if key == "cutoff" else ""
                raise InputError(f"{where}.{key}: required key is missing for {kind}{more}")
            continue
        value = number(where, key, given[key])
        if (sign == POSITIVE and not value > 0) or (sign == NOT_NEGATIVE and value < 0):
            raise InputError(f"{where}.{key}: must be {sign}, got {shown(given[key])}")
        found[key] = value
    if kind == "power-law" and found["alpha"] >= 3:
        raise InputError(f"{where}.alpha: must be less than 3, where the mass at the centre is infinite")
    if "strength" in given:
        found["strength"] = given["strength"]
        try:
            program_of(given["strength"])
        except InputError as error:
            raise InputError(f"{where}.strength: {error}") from None
    return found


def _keys(kind: str) -> str:
    return ", ".join(f"{key} = …" for key, (_, default) in KINDS[kind].takes.items() if default is None)


def milky_way() -> list[dict[str, Any]]:
    """Parts of MWPotential2014 in the units G = 1, ro = 1 and vo = 1 (Bovy 2015, table 1)."""
    from scipy.special import gammainc

    cutoff, a, b, halo = 1.9 / 8.0, 3.0 / 8.0, 0.28 / 8.0, 2.0
    inside = {
        "power-law": gammainc(0.6, cutoff**-2.0),
        "miyamoto-nagai": (1.0 + (a + b) ** 2) ** -1.5,
        "nfw": math.log1p(1.0 / halo) - 1.0 / (1.0 + halo),
    }
    shapes = {
        "power-law": {"alpha": 1.8, "cutoff": cutoff}, "miyamoto-nagai": {"a": a, "b": b}, "nfw": {"a": halo}
    }  # fmt: skip
    return [{"kind": kind, "mass": share / float(inside[kind]), **shapes[kind]} for kind, share in PARTS.items()]


def row_of(part: Mapping[str, Any], gravity: float) -> list[float]:
    """Numbers of a part for the compiled code: kind, G M, four parameters, angle and its rate, two constants."""
    kind = part["kind"]
    scale = part["speed"] ** 2 if kind == "logarithmic" else gravity * part["mass"]
    shape = [part[key] for key in KINDS[kind].takes if key not in ("mass", "speed", "angle", "omega")]
    more = [0.0, 0.0]
    if kind == "power-law":
        more = [1.0 / math.gamma(1.5 - 0.5 * part["alpha"]), _constant(1.0 - 0.5 * part["alpha"])]
    turn = [math.radians(part.get("angle", 0.0)), part.get("omega", 0.0)]
    return [float(CODES[kind]), scale, *shape, *[0.0] * (4 - len(shape)), *turn, *more]


def _constant(a: float) -> float:
    """(Gamma(1 + a) - 1) / a, from its series near a = 0."""
    if abs(a) < 1e-4:
        euler = float(np.euler_gamma)
        return -euler + a * (0.5 * euler**2 + math.pi**2 / 12.0) - 0.9074790760808863 * a * a
    return (math.gamma(1.0 + a) - 1.0) / a


def strength_at(part: Mapping[str, Any], time: float) -> float:
    """The strength of a part at a time; nan if it has no value."""
    if "strength" not in part:
        return 1.0
    formula = formula_of(part["strength"], "t")
    try:
        return float(value_of(formula.tree, {"t": float(time)}, formula.given))
    except (ArithmeticError, ValueError):
        return math.nan


def program_of(text: Any) -> list[tuple[int, float]]:
    """A formula of t as operations on a stack, each with its number. Raises InputError."""
    if not isinstance(text, str):
        raise InputError(f"expected a formula of the time t as text, got {shown(text)}")
    formula = formula_of(text, "t")
    if formula.parameters:
        raise InputError(f"the formula has the name {shown(formula.parameters[0])}; it may have t, the time, alone")
    made: list[tuple[int, float]] = []

    def add(node: ast.expr) -> None:
        if isinstance(node, ast.Constant):
            made.append((OPERATIONS.index("number"), float(node.value)))  # type: ignore[arg-type]
        elif isinstance(node, ast.Name):
            name = node.id[2:]
            if name == "t":
                made.append((OPERATIONS.index("t"), 0.0))
            else:
                add(formula.given[name])
        elif isinstance(node, ast.UnaryOp):
            add(node.operand)
            made.append((OPERATIONS.index("neg"), 0.0))
        elif isinstance(node, ast.BinOp):
            add(node.left)
            add(node.right)
            made.append((OPERATIONS.index(type(node.op).__name__), 0.0))
        else:
            assert isinstance(node, ast.Call)
            assert isinstance(node.func, ast.Name)
            for each in node.args:
                add(each)
            made.append((OPERATIONS.index(node.func.id[2:]), 0.0))

    add(formula.tree)
    return made
