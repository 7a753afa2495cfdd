"""State of objects for checkpoints: copies of arrays, numbers, texts, None, and lists and dicts of these.

Another process can restore such a state.
"""

from operator import attrgetter
from typing import Any, ClassVar

import numpy as np

from kickdrift.errors import InputError

Memory = dict[str, Any]


class Checkpointed:
    """Object that declares by name which attributes a checkpoint holds.

    Attributes
    ----------
    saved : names of attributes, dotted for an attribute of a part ("_bodies.times"). In the memory each has its last
        name, without the underscore
    """

    saved: ClassVar[tuple[str, ...]] = ()

    def memory(self) -> Memory:
        """Return copies of the saved attributes."""
        return {label(name): by_value(attrgetter(name)(self)) for name in self.saved}

    def recall(self, memory: Memory) -> None:
        """Restore the saved attributes from a memory."""
        for name in self.saved:
            put_back(self, name, memory[label(name)])


def label(name: str) -> str:
    """Name of an attribute in a memory."""
    return name.split(".")[-1].lstrip("_")


def by_value(value: Any) -> Any:
    """Copy a value: its arrays are NumPy's, its numbers Python's own, and the copy shares no memory."""
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
    """Set a (dotted) attribute to a value from a memory. An existing array is overwritten in place.

    A memory may come from a file, and compiled code trusts the shapes of arrays. So an InputError says what does not
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
