"""What objects remember, by value: copies of arrays, numbers, texts, None, and lists and dicts of these, which another
process can put back.
"""

from __future__ import annotations

from operator import attrgetter
from typing import Any, ClassVar

import numpy as np

from kickdrift.errors import InputError

Memory = dict[str, Any]


class Remembering:
    """What is remembered is declared by name.

    Attributes
    ----------
    keeps : names of attributes, dotted where they are parts of a part ("_bodies.times"); in the memory they stand under
        their last name, without the underscore
    """

    keeps: ClassVar[tuple[str, ...]] = ()

    def memory(self) -> Memory:
        """What is remembered; copies."""
        return {label(name): by_value(attrgetter(name)(self)) for name in self.keeps}

    def recall(self, memory: Memory) -> None:
        """Be what had this memory."""
        for name in self.keeps:
            put_back(self, name, memory[label(name)])


def label(name: str) -> str:
    """What an attribute is called in a memory."""
    return name.split(".")[-1].lstrip("_")


def by_value(value: Any) -> Any:
    """A copy that shares nothing, of Python's own numbers and NumPy's arrays."""
    if isinstance(value, np.ndarray):
        return np.array(value, order="C")
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, (list, tuple)):
        return [by_value(each) for each in value]
    if isinstance(value, dict):
        return {key: by_value(each) for key, each in value.items()}
    return value


def put_back(owner: Any, name: str, value: Any) -> None:
    """Give a (dotted) attribute a remembered value; an array that is there already keeps its place.

    A memory may come from a file, and compiled code trusts the shapes of its arrays: an InputError says what does not
    fit.
    """
    *parts, last = name.split(".")
    for part in parts:
        owner = getattr(owner, part)
    there = getattr(owner, last, None)
    if isinstance(there, np.ndarray) and isinstance(value, np.ndarray) and there.shape == value.shape:
        if not np.can_cast(value.dtype, there.dtype, "same_kind"):
            raise InputError(f"checkpoint: {label(name)} does not hold the expected numbers")
        there[...] = value
    elif isinstance(there, np.ndarray) and not isinstance(getattr(type(owner), last, None), property):
        raise InputError(f"checkpoint: {label(name)} does not have the shape that this system needs")
    elif any(isinstance(there, kind) and not isinstance(value, kind) for kind in (int | float, str)):
        raise InputError(f"checkpoint: {label(name)} does not fit a run of this system")
    else:
        setattr(owner, last, by_value(value))
