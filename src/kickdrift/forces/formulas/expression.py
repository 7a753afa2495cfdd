"""Formulas as text, in OpenMM's notation, as the code of a law and of its slope.

A formula is an expression, and definitions after it: ``k*d^2; d=r-r0``. Python's parser reads the text, and a short
list says what may stand in it; no text of a formula is run. The slope follows by the chain rule, step by step. Parts
without the variable are numbers of a law, computed once for each set of parameters.
"""

from __future__ import annotations

import ast
import math
import re
from collections.abc import Callable, Iterator, Mapping
from functools import cache, lru_cache
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from kickdrift.errors import InputError
from kickdrift.text import choices, shown, suggestion

LONGEST = 10_000  # characters of a formula
DEEPEST = 200  # of parts within one another
_WORD = re.compile(r"(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|([A-Za-z_]\w*)", re.ASCII)

Numeric = Callable[..., float]
FUNCTIONS: dict[str, tuple[int, Numeric]] = {  # number of arguments, and the value
    "sqrt": (1, math.sqrt), "exp": (1, math.exp), "log": (1, math.log), "sin": (1, math.sin), "cos": (1, math.cos),
    "tan": (1, math.tan), "sec": (1, lambda x: 1.0 / math.cos(x)), "csc": (1, lambda x: 1.0 / math.sin(x)),
    "cot": (1, lambda x: 1.0 / math.tan(x)), "sinh": (1, math.sinh), "cosh": (1, math.cosh), "tanh": (1, math.tanh),
    "square": (1, lambda x: x * x), "cube": (1, lambda x: x * x * x), "recip": (1, lambda x: 1.0 / x),
    "abs": (1, abs), "step": (1, lambda x: 0.0 if x < 0.0 else 1.0), "min": (2, min), "max": (2, max),
    "select": (3, lambda x, yes, no: yes if x != 0.0 else no),
}  # fmt: skip
# For a power of a negative number, which has a value where the exponent is whole: the factor of the power, and that of
# the number in the logarithm, which 1 leaves without a value. No formula can call these names.
PARITY, MIRROR = "(-1)^", "-1 if whole"
INNER: dict[str, Numeric] = {PARITY: lambda n: 1.0 - 2.0 * (n % 2.0), MIRROR: lambda n: 1.0 if n % 1.0 else -1.0}
WRITTEN: dict[str, str] = {  # functions of others
    "tan": "sin(x)/cos(x)", "sec": "1/cos(x)", "csc": "1/sin(x)", "cot": "cos(x)/sin(x)",
    "sinh": "0.5*(exp(x)-exp(-x))", "cosh": "0.5*(exp(x)+exp(-x))", "tanh": "1-2/(exp(min(2*x,80))+1)", "square": "x*x",
    "cube": "x*x*x", "recip": "1/x", "abs": "select(step(x), x, -x)", "min": "select(step(x-y), y, x)",
    "max": "select(step(x-y), x, y)",
}  # fmt: skip
SLOPES: dict[str, str] = {  # of functions of code, by the value f and the argument x
    "sqrt": "0.5 / {f}", "exp": "{f}", "log": "1.0 / {x}", "sin": "math.cos({x})", "cos": "-math.sin({x})",
}  # fmt: skip
NEVER_RAISES = SimpleNamespace(sqrt=np.sqrt, exp=np.exp, log=np.log, sin=np.sin, cos=np.cos, pow=np.power)
OPERATORS: dict[type, Numeric] = {
    ast.Add: lambda a, b: a + b, ast.Sub: lambda a, b: a - b, ast.Mult: lambda a, b: a * b,
    ast.Div: lambda a, b: a / b, ast.Pow: lambda a, b: math.pow(a, b),
}  # fmt: skip


class Formula(NamedTuple):
    """A formula that was read.

    Attributes
    ----------
    text : as it was given
    tree : the expression
    given : expressions by name, of the definitions
    parameters : names without a definition, without the variable
    """

    text: str
    tree: ast.expr
    given: Mapping[str, ast.expr]
    parameters: tuple[str, ...]


@lru_cache(maxsize=256)
def formula_of(text: str, variable: str) -> Formula:
    """Read a formula of this variable. Raises InputError for what cannot stand in a formula."""
    if len(text) > LONGEST:
        raise InputError(f"formula: has {len(text):,} characters; at most {LONGEST:,} are read")
    main, *rest = (part.strip() for part in text.split(";"))
    tree, given = _parsed(main), {}
    for part in filter(None, rest):
        name, equals, value = map(str.strip, part.partition("="))
        if not equals or not re.fullmatch(r"[A-Za-z_]\w*", name, re.ASCII):
            raise InputError(f"formula: expected name=expression after ';', got {shown(part)}")
        if name == variable or name in given:
            what = "the variable, which has no definition" if name == variable else "defined twice"
            raise InputError(f"formula: {shown(name)} is {what}")
        given[name] = _parsed(value)
    names = dict.fromkeys(_used(tree, given))
    return Formula(text, tree, given, tuple(name for name in names if name != variable))


def _parsed(text: str) -> ast.expr:
    """The tree of an expression, whose names begin with ``v_``, so that none is a word of Python."""
    plain = _WORD.sub(lambda found: f"v_{found[1]}" if found[1] else found[0], text)
    plain = plain.replace("**", "*?*").replace("#", "?")  # Python's power, and its comments
    try:
        tree = ast.parse(" ".join(plain.replace("^", "**").split()), mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise InputError(f"formula: {shown(text)} is no expression such as k*(r-r0)^2") from None
    _check(tree, 0)
    return tree


def renamed(text: str, new: Mapping[str, str]) -> str:
    """The text of a formula with other words for some of its names, those of functions left out."""

    def word(found: re.Match[str]) -> str:
        return found[0] if text[found.end() :].lstrip().startswith("(") else new.get(found[1], found[0])

    return _WORD.sub(word, text)


def _check(node: ast.AST, depth: int) -> None:
    """Refuse an expression that has more than numbers, names, operators and functions of the list."""
    parts: list[ast.expr] = []
    if depth > DEEPEST:
        raise InputError(f"formula: has more than {DEEPEST} parts within one another")
    if isinstance(node, ast.Constant) and type(node.value) in (int, float):
        if not _is_finite(node.value):
            raise InputError("formula: has a number that is too large")
        return
    if isinstance(node, ast.Name) and node.id.startswith("v_"):
        return
    if isinstance(node, ast.BinOp) and type(node.op) in OPERATORS:
        parts = [node.left, node.right]
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        parts = [node.operand]
    elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and not node.keywords:
        name, parts = node.func.id[2:], node.args
        if name not in FUNCTIONS:
            raise InputError(
                f"formula: function {shown(name)} is not there{suggestion(name, FUNCTIONS)}; there are "
                f"{choices(FUNCTIONS)}"
            )
        if len(parts) != FUNCTIONS[name][0]:
            raise InputError(f"formula: {name} takes {FUNCTIONS[name][0]} arguments, got {len(parts)}")
    else:
        raise InputError(f"formula: {shown(ast.unparse(node).replace('v_', ''))} is not part of a formula")
    for part in parts:
        _check(part, depth + 1)


def _is_finite(value: Any) -> bool:
    try:
        return math.isfinite(value)
    except OverflowError:  # of a whole number
        return False


def _named(node: ast.AST) -> Iterator[str]:
    """Names in an expression, without those of the functions that it calls."""
    if isinstance(node, ast.Name):
        yield node.id[2:]
    for part in node.args if isinstance(node, ast.Call) else ast.iter_child_nodes(node):
        yield from _named(part)


def _used(tree: ast.expr, given: Mapping[str, ast.expr]) -> Iterator[str]:
    """Names without a definition, those in definitions too. Refuses a definition that needs itself."""
    done: set[str] = set()

    def names(node: ast.AST, within: tuple[str, ...]) -> Iterator[str]:
        for name in _named(node):
            if name in within:
                raise InputError(f"formula: the definition of {shown(name)} needs itself")
            if name in given and name not in done:
                if len(within) == DEEPEST:
                    raise InputError(f"formula: has more than {DEEPEST} definitions within one another")
                yield from names(given[name], (*within, name))
                done.add(name)
            elif name not in given:
                yield name

    return names(tree, ())


def value_of(node: ast.expr, names: dict[str, float], given: Mapping[str, ast.expr]) -> float:
    """The value of an expression without the variable. The values of definitions are added to ``names``."""
    if isinstance(node, ast.Constant):
        return float(node.value)  # type: ignore[arg-type]
    if isinstance(node, ast.Name):
        name = node.id[2:]
        if name not in names:
            names[name] = value_of(given[name], names, given)
        return names[name]
    if isinstance(node, ast.UnaryOp):
        return -value_of(node.operand, names, given)
    if isinstance(node, ast.BinOp):
        return OPERATORS[type(node.op)](value_of(node.left, names, given), value_of(node.right, names, given))
    assert isinstance(node, ast.Call)
    assert isinstance(node.func, ast.Name)
    name = node.func.id[2:]
    function = INNER[name] if name in INNER else FUNCTIONS[name][1]
    return function(*(value_of(each, names, given) for each in node.args))


class Term(NamedTuple):
    """The words of code for a value and its slope; no slope for one without the variable."""

    value: str
    slope: str | None


class Writer:
    """Writes the steps of a formula's code, and keeps the parts without the variable. Laws of pairs are compiled for
    SIMD lanes, where ``np.where`` chooses."""

    def __init__(self, formula: Formula, variable: str, lanes: bool) -> None:
        self.formula, self.lanes = formula, lanes
        self.lines: list[str] = []
        self.numbers: list[ast.expr] = []
        self._known: dict[str, Term] = {variable: Term("x", "1.0")}
        self._places: dict[str, Term] = {}
        self._needing: dict[str, bool] = {}

    def whole(self) -> Term:
        """Write the whole formula."""
        return self._term(self.formula.tree)

    def _depends(self, node: ast.expr) -> bool:
        return any(name in self._known or self._needs(name) for name in set(_named(node)))

    def _needs(self, name: str) -> bool:
        """Whether the definition of a name needs the variable."""
        if name not in self._needing:
            self._needing[name] = name in self.formula.given and self._depends(self.formula.given[name])
        return self._needing[name]

    def _step(self, value: str, slope: str | None) -> Term:
        """A step of the code, with its slope as another."""
        name = f"t{len(self.lines)}"
        self.lines.append(f"{name} = {value}")
        if slope is None:
            return Term(name, None)
        self.lines.append(f"d{name} = {slope}")
        return Term(name, f"d{name}")

    def _sloped(self, made: Term, slope: str | None) -> Term:
        """A step whose slope is another step."""
        return made if slope is None else made._replace(slope=self._step(slope, None).value)

    def _term(self, node: ast.expr) -> Term:
        if not self._depends(node):
            return self._number(node)
        if isinstance(node, ast.Name):
            name = node.id[2:]
            if name not in self._known:
                self._known[name] = self._term(self.formula.given[name])
            return self._known[name]
        if isinstance(node, ast.UnaryOp):
            inner = self._term(node.operand)
            return self._step(f"-{inner.value}", inner.slope and f"-{inner.slope}")
        if isinstance(node, ast.BinOp):
            return self._binary(node)
        assert isinstance(node, ast.Call)
        assert isinstance(node.func, ast.Name)
        return self._function(node.func.id[2:], node.args)

    def _number(self, node: ast.expr) -> Term:
        """A part without the variable: a number of the law, or of the formula itself."""
        if (value := self._plain(node)) is not None:
            return Term(f"({value!r})" if value < 0.0 else repr(value), None)
        key = ast.dump(node)
        if key not in self._places:
            self._places[key] = Term(f"p.c{len(self.numbers)}", None)
            self.numbers.append(node)
        return self._places[key]

    def _binary(self, node: ast.BinOp) -> Term:
        if isinstance(node.op, ast.Pow):
            return self._power(node)
        a, b = self._term(node.left), self._term(node.right)
        slopes: list[str] = []
        if isinstance(node.op, ast.Add | ast.Sub):
            sign = "+" if isinstance(node.op, ast.Add) else "-"
            second = b.slope and (f"-{b.slope}" if sign == "-" and not a.slope else b.slope)
            slope = f"{a.slope} {sign} {second}" if a.slope and second else a.slope or second
            return self._step(f"{a.value} {sign} {b.value}", slope)
        if isinstance(node.op, ast.Mult):
            slopes = [s for s in (a.slope and f"{a.slope} * {b.value}", b.slope and f"{a.value} * {b.slope}") if s]
            return self._step(f"{a.value} * {b.value}", " + ".join(slopes) or None)
        made = self._step(f"{a.value} / {b.value}", None)
        slopes = [s for s in (a.slope, b.slope and f"- {made.value} * {b.slope}") if s]
        return self._sloped(made, f"({' '.join(slopes)}) / {b.value}" if slopes else None)

    def _power(self, node: ast.BinOp) -> Term:
        base, power = self._term(node.left), self._plain(node.right)
        if power is not None:
            if abs(power) == 0.5:
                root = self._function("sqrt", [node.left])
                return root if power > 0 else self._over(root)
            if power == int(power) and 0 < abs(power) <= 64:
                n = int(abs(power))
                slope = base.slope and (base.slope if n == 1 else f"{n}.0 * {base.value} ** {n - 1} * {base.slope}")
                made = self._step(f"{base.value} ** {n}" if n > 1 else base.value, slope)
                return made if power > 0 else self._over(made)
        if not self._depends(node.right):
            return self._power_of_number(base, node.right)
        exponent = self._term(node.right)
        log = self._step(f"math.log({base.value})", base.slope and f"{base.slope} / {base.value}")
        parts = [s for s in (log.slope and f"{exponent.value} * {log.slope}",
                             exponent.slope and f"{exponent.slope} * {log.value}") if s]  # fmt: skip
        made = self._step(f"math.exp({exponent.value} * {log.value})", None)
        return self._sloped(made, f"{made.value} * ({' + '.join(parts)})" if parts else None)

    def _power_of_number(self, base: Term, exponent: ast.expr) -> Term:
        """A power by a parameter. A negative base has a value where the parameter is whole, as in OpenMM."""
        n, less = self._number(exponent).value, ast.BinOp(exponent, ast.Sub(), ast.Constant(1.0))
        below = self._number(less).value
        if not self.lanes:
            made = self._step(f"math.pow({base.value}, {n})", None)
            return self._sloped(made, f"{n} * math.pow({base.value}, {below}) * {base.slope}")
        sign, mirror = (self._number(ast.Call(ast.Name(f"v_{name}"), [exponent], [])).value for name in INNER)
        negative = f"{base.value} < 0.0"
        log = self._step(f"math.log({self._choice(negative, f'{mirror} * {base.value}', base.value)})", None).value
        made = self._step(f"math.exp({n} * {log}) * {self._choice(negative, sign, '1.0')}", None)
        slope = f"{n} * math.exp({below} * {log}) * {self._choice(negative, f'-{sign}', '1.0')} * {base.slope}"
        return self._sloped(made, slope)

    @staticmethod
    def _plain(node: ast.expr) -> float | None:
        """The value of an expression of plain numbers; None for one with names or functions, or without a value."""
        if any(isinstance(each, ast.Name) for each in ast.walk(node)):
            return None
        try:
            value = value_of(node, {}, {})
        except (ArithmeticError, ValueError):
            return None
        return value if math.isfinite(value) else None

    def _over(self, of: Term) -> Term:
        """One over a value."""
        made = self._step(f"1.0 / {of.value}", None)
        return self._sloped(made, of.slope and f"-{of.slope} * {made.value} * {made.value}")

    def _function(self, name: str, arguments: list[ast.expr]) -> Term:
        terms = [self._term(each) for each in arguments]
        if name in WRITTEN:
            inner = Writer(_written(name), "", self.lanes)
            inner.lines, inner.numbers, inner._places = self.lines, self.numbers, self._places
            inner._known = dict(zip("xy", terms, strict=False))
            return inner.whole()
        if name == "step":
            return self._step(self._choice(f"{terms[0].value} < 0.0", "0.0", "1.0"), None)
        if name == "select":
            of = terms[0].value
            if self.lanes and not self._depends(arguments[0]):
                of = f"({of} + 0.0 * x)"
            when = f"({of} < 0.0) | ({of} > 0.0)" if self.lanes else f"{of} != 0.0"  # lanes have no other way
            sloped = any(each.slope for each in terms[1:])
            slope = self._choice(when, *(each.slope or "0.0" for each in terms[1:])) if sloped else None
            return self._step(self._choice(when, terms[1].value, terms[2].value), slope)
        (inside,) = terms
        made = self._step(f"math.{name}({inside.value})", None)
        slope = SLOPES[name].format(f=made.value, x=inside.value)
        return self._sloped(made, inside.slope and f"({slope}) * {inside.slope}")

    def _choice(self, when: str, yes: str, no: str) -> str:
        return f"np.where({when}, {yes}, {no})" if self.lanes else f"{yes} if {when} else {no}"


@cache
def _written(name: str) -> Formula:
    text = WRITTEN[name]
    return Formula(text, _parsed(text), {}, ())


class Law(NamedTuple):
    """The law of a formula: the class of its numbers, and the expressions that give them from the parameters."""

    Parameters: Any
    formula: Formula
    numbers: tuple[ast.expr, ...]

    def of(self, where: str, values: Mapping[str, float], length: float, energy: float) -> Any:
        """The law's numbers for these parameters. ``where`` begins messages."""
        if missing := [name for name in self.formula.parameters if name not in values]:
            raise InputError(f"{where}: parameters: {shown(missing[0])} of the formula has no value")
        try:
            known = {name: float(values[name]) for name in self.formula.parameters}
            numbers = [value_of(each, known, self.formula.given) for each in self.numbers]
        except (ArithmeticError, ValueError):
            said = ", ".join(f"{key} = {values[key]:g}" for key in self.formula.parameters)
            raise InputError(f"{where}: the formula has no value{said and f' for {said}'}") from None
        return self.Parameters(1.0 / length, energy, *numbers)


def _plain_value(p: Any, at: float) -> Any:
    """Energy and slope of a law of a formula without compiling; numbers without a value are nan."""
    with np.errstate(all="ignore"):
        return p.safe_law(np.float64(at))


@lru_cache(maxsize=256)
def law_of(text: str, variable: str) -> Law:
    """The law of a formula of r (pairs have ``r2``), of a bond's r, or of an angle, ``theta``.

    Code for lanes and code for single numbers differ in their choices, so pairs ask for the variable ``r2``."""
    pairs = variable == "r2"
    word = "r" if pairs else variable
    try:
        formula = formula_of(text, word)
        writer = Writer(formula, word, pairs)
        made = writer.whole()
    except RecursionError:
        raise InputError(f"formula: {shown(text)} has too many parts within one another") from None
    slope = made.slope or "0.0 * x"
    angle = word != "r"
    lines = [
        f"def law(p, {'r2' if pairs else 'value'}):",
        *(["    r = math.sqrt(r2)", "    x = r * p.per_length"] if pairs
          else ["    x = value" if angle else "    x = value * p.per_length"]),
        *(f"    {line}" for line in writer.lines),
        f"    energy, slope = p.energy * ({made.value} + 0.0 * x), p.energy * ({slope})",
        *(["    return energy, -slope * p.per_length / r"] if pairs
          else [f"    return energy, slope{'' if angle else ' * p.per_length'}"]),
    ]  # fmt: skip
    scope, safe = (dict[str, Any]({"math": each, "np": np, "__name__": __name__}) for each in (math, NEVER_RAISES))
    for names in (scope, safe):
        exec("\n".join(lines), names)
    fields = [("per_length", float), ("energy", float), *((f"c{k}", float) for k in range(len(writer.numbers)))]
    made_class: Any = NamedTuple("FormulaLaw", fields)  # type: ignore[misc]
    cls: Any = made_class
    cls.law, cls.safe_law, cls.plain = scope["law"], safe["law"], _plain_value
    cls.said = f"formula {shown(' '.join(text.split()))}"
    return Law(cls, formula, tuple(writer.numbers))
