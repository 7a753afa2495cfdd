"""Messages for wrong arguments of a class."""

from __future__ import annotations

import inspect
from functools import wraps
from typing import Any, TypeVar

from kickdrift.errors import InputError
from kickdrift.model.checks.other_names import other_name
from kickdrift.text import suggestion

Class = TypeVar("Class", bound=type)


def hint(unknown: str, names: list[str]) -> str:
    """Text ``; rc is 'cutoff' here`` or ``; did you mean 'epsilon'?``, else ""."""
    theirs = other_name("argument", unknown)
    return theirs if any(f"{name!r}" in theirs for name in names) else suggestion(unknown, names)


def checked_arguments(cls: Class) -> Class:
    """Class decorator: an unknown, missing or superfluous argument raises InputError, not TypeError.

    The line names the class, the nearest argument, and all arguments."""
    made: Any = cls
    initial = made.__init__
    signature = inspect.signature(initial)
    names = [name for name in signature.parameters if name != "self"]

    @wraps(initial)
    def init(self: Any, *args: Any, **given: Any) -> None:
        try:
            signature.bind(self, *args, **given)
        except TypeError as error:
            unknown = next((key for key in given if key not in names), None)
            what = str(error) if unknown is None else f"no argument {unknown!r}{hint(unknown, names)}"
            raise InputError(
                f"{type(self).__name__}: {what} ({type(self).__name__} takes {', '.join(names)})"
            ) from None
        initial(self, *args, **given)

    made.__init__ = init
    return cls


def misfit(function: Any, *arguments: Any) -> str:
    """The signature of a function that cannot be called with these arguments, as text; "" if it can."""
    try:
        signature = inspect.signature(function)
    except (TypeError, ValueError):  # a builtin without a signature
        return ""
    try:
        signature.bind(*arguments)
    except TypeError:
        return str(signature)
    return ""
