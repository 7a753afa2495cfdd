"""Output of the command line for one integrator, on standard output."""

from __future__ import annotations

from kickdrift.cli.console import print_lines, print_table
from kickdrift.integrators import integrator as method_named
from kickdrift.integrators.option import DT, Option

_YES = {True: "yes", False: "no"}
OPTION_COLUMNS = ["option", "type", "unit", "default", "choices", "what it does"]


def print_method(name: str) -> None:
    """Print an integrator and its options."""
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
    print_lines([line for line in lines if line[1]])
    rows = [option_row(each, method.needs_dt) for each in method.options]
    print_table(None, OPTION_COLUMNS, rows)


def option_row(option: Option, needs_dt: bool = False) -> list[str]:
    """Row of an option in a table."""
    default = "required" if needs_dt and option is DT else option.fallback
    return [option.name, option.words, option.unit, default, option.known, option.help]
