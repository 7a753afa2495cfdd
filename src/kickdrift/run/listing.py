"""Lists of integrators, forces, systems and engines, and what is known of one integrator."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from kickdrift.display.showing import Lines, Shown, Table
from kickdrift.errors import InputError
from kickdrift.integrators import integrator as method_named
from kickdrift.integrators.options import DT, Option
from kickdrift.text import VALUE, clean, shown, suggestion

_YES = {True: "yes", False: "no"}
OPTION_COLUMNS = ["option", "type", "unit", "default", "choices", "what it does"]


@dataclass(frozen=True, repr=False)
class Listing(Shown):
    """A list that prints as a table.

    Attributes
    ----------
    columns : names of the columns
    rows : texts, one for each column
    about : keys and texts about an integrator, above its options; empty for a list
    """

    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    about: tuple[tuple[str, str], ...] = ()
    _lines_first = True

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def names(self) -> list[str]:
        """The first column."""
        return [row[0] for row in self.rows]

    def as_json(self) -> dict[str, Any]:
        """The rows as dictionaries, and what is known about an integrator."""
        return {**dict(self.about), "rows": [dict(zip(self.columns, row, strict=True)) for row in self.rows]}

    def _lines(self) -> Lines:
        return list(self.about)

    def _tables(self) -> list[Table]:
        return [(None, list(self.columns), [list(row) for row in self.rows])]


def listing(what: str, name: str | None = None) -> Listing:
    """List "integrators", "forces", "systems" or "engines", or explain the integrator ``name`` and its options.

    Returns
    -------
    Listing
        With ``names``, ``columns`` and ``rows``; ``print`` shows the table of ``kickdrift list``.

    Raises
    ------
    InputError
        For an unknown list or integrator.
    """
    if what not in LISTINGS:
        raise InputError(f"list: expected one of {', '.join(LISTINGS)}, got {shown(what)}{suggestion(what, LISTINGS)}")
    if name is not None:
        if what != "integrators":
            raise InputError(f"list {what} {clean(name, VALUE)}: only integrators are explained by name")
        return _explained(name)
    columns, rows = LISTINGS[what]()
    return Listing(tuple(columns), _frozen(rows))


def _frozen(rows: list[list[str]]) -> tuple[tuple[str, ...], ...]:
    return tuple(tuple(row) for row in rows)


def _integrators() -> tuple[list[str], list[list[str]]]:
    """Table of every integrator and its properties."""
    from kickdrift.integrators import INTEGRATORS

    columns = ["name", "family", "order", "evaluations", "symplectic", "reversible", "adaptive", "use"]
    rows = [
        [
            name,
            method.family,
            str(method.order),
            str(method.evaluations or "varies"),
            _YES[method.symplectic],
            _YES[method.reversible],
            _YES[method.chooses_steps],
            method.use if name == method.name else f"the same as {method.name}",
        ]
        for name, method in INTEGRATORS.items()
    ]
    return columns, rows


def _forces() -> tuple[list[str], list[list[str]]]:
    """Table of every force and its parameters."""
    import inspect

    from kickdrift.forces import FORCES

    rows = [
        [name, ", ".join(inspect.signature(force).parameters), _purpose(force.__doc__ or "")]
        for name, force in FORCES.items()
    ]
    return ["name", "parameters", "description"], rows


def _purpose(text: str) -> str:
    """The first paragraph of a docstring up to its source, as plain text."""
    return " ".join(text.split("\n\n")[0].split()).replace("`", "").split("; ")[0].rstrip(".")


def _systems() -> tuple[list[str], list[list[str]]]:
    """Table of every shipped system file."""
    from kickdrift.systemfile.files import describe, shipped

    found = [describe(path) for path in shipped().values()]
    return ["name", "units", "title"], [[each.name, each.units, each.title] for each in found]


def _engines() -> tuple[list[str], list[list[str]]]:
    """Table of every engine and its installed version."""
    from kickdrift.engines import ENGINES

    return ["name", "version", "runs"], [
        [name, each.version or f"not installed: {each.install}", each.runs] for name, each in ENGINES.items()
    ]


LISTINGS: dict[str, Callable[[], tuple[list[str], list[list[str]]]]] = {
    "integrators": _integrators,
    "forces": _forces,
    "systems": _systems,
    "engines": _engines,
}


def _explained(name: str) -> Listing:
    """An integrator and its options."""
    method = method_named(name)
    steps = "from the error" if method.adaptive else "by the method" if method.chooses_steps else "fixed"
    lines = [
        ("integrator", name if name == method.name else f"{name}, the same as {method.name}"),
        ("family", method.family),
        ("order", str(method.order)),
        ("symplectic", _YES[method.symplectic]),
        ("reversible", _YES[method.reversible]),
        ("steps", steps),
        ("evaluations", f"{method.evaluations} of the force per step" if method.evaluations else "varies"),
        ("runs", "particles" if method.particles_only else "particles and ODEs"),
        ("use", method.use),
        ("source", method.source),
    ]
    rows = [option_row(each, method.needs_dt) for each in method.options]
    return Listing(tuple(OPTION_COLUMNS), _frozen(rows), tuple(line for line in lines if line[1]))


def option_row(option: Option, needs_dt: bool = False) -> list[str]:
    default = "required" if needs_dt and option is DT else option.fallback
    return [option.name, option.words, option.unit, default, option.known, option.help]
