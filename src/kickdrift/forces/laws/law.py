"""Common parts of the decorators that make a force of a law: a NamedTuple class of parameters with one formula.

``pair_law``, ``field_law`` and ``body_law`` use these. This module does not import numba.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping
from typing import Any, NamedTuple

from kickdrift.forces.laws.check import check_class
from kickdrift.forces.laws.state import check_stateless
from kickdrift.forces.seam.arguments import opposite
from kickdrift.forces.seam.registration import register_force
from kickdrift.model.checks.arguments import checked_arguments

TRAITS = (
    "velocity_dependent", "time_dependent", "works", "external", "may_overlap", "joins", "by_mass", "below_light",
    "stands_for",
)  # fmt: skip


def traits_of(cls: Any, more: tuple[str, ...] = ()) -> dict[str, Any]:
    """What a law's class says about the force, for the namespace of the force's class: its traits, as values or as
    properties of the parameters, and ``reversed``."""
    found: dict[str, Any] = {}
    for trait in (*TRAITS, *more):
        if trait in vars(cls):
            value = vars(cls)[trait]
            found[trait] = _of_law(trait) if isinstance(value, property) else value
    if "works" not in found and found.get("time_dependent"):
        found["works"] = found["time_dependent"]
    if "reversed" in vars(cls):
        found["reversed"] = lambda force: force.with_law(force.law.reversed())
    elif "odd_in_time" in vars(cls):
        found["reversed"] = lambda force: force.with_law(mirrored(force.law))
    return found


def mirrored(law: Any) -> Any:
    """The parameters of the motion back in time: those that the law's class names in ``odd_in_time`` change sign."""
    return law._replace(**{key: opposite(getattr(law, key)) for key in law.odd_in_time})


def _of_law(trait: str) -> property:
    return property(lambda force: getattr(force.law, trait), doc=f"What the law says for its parameters: {trait}.")


class Form(NamedTuple):
    """Form of one kind of law.

    Attributes
    ----------
    decorator : the decorator's name, for messages
    arguments : names of the law's arguments
    alone : what the law's values may depend on, for the message about laws that keep state
    """

    decorator: str
    arguments: tuple[str, ...]
    alone: str


def force_of_law(
    cls: Any, base: type, form: Form, hints: Mapping[str, Any], dimensions: Mapping[str, str], **namespace: Any
) -> Any:
    """Make a registered class of forces from a NamedTuple class with a ``law``.

    The force is a frozen dataclass under ``base``. Its fields are the law's parameters, and its class attribute
    ``Parameters`` is the NamedTuple class. The force's ``name`` is the class's name in lower case, with hyphens.

    Parameters
    ----------
    cls : NamedTuple class with a function ``law``
    base : dataclass whose fields the force has as well
    form : the kind of law
    hints : types of the parameters, by name, as system files check them; default float
    dimensions : kinds of the base's quantities, beside the law's own ``dimensions``
    namespace : more attributes of the class

    Raises
    ------
    InputError
        If this is not a NamedTuple class with such a law, if the law keeps state, or if its name is taken.
    """
    check_class(cls, form.decorator, form.arguments)
    check_stateless(cls.__name__, cls.law, form.alone)
    defaults: dict[str, Any] = cls._field_defaults
    force: Any = checked_arguments(
        dataclasses.make_dataclass(
            cls.__name__,
            [
                (key, hints.get(key, float), *([dataclasses.field(default=defaults[key])] if key in defaults else []))
                for key in cls._fields
            ],
            bases=(base,),
            frozen=True,
            namespace={
                "__doc__": cls.__doc__,
                "name": vars(cls).get("name", re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "-", cls.__name__).lower()),
                "dimensions": {**dimensions, **getattr(cls, "dimensions", {})},
                **namespace,
            },
        )
    )
    force.__module__ = cls.__module__
    force.__qualname__ = cls.__qualname__
    cls.__qualname__ = f"{cls.__qualname__}.Parameters"  # pickle finds the class at its new place
    force.Parameters = cls
    return register_force(force, overwrite=True)
