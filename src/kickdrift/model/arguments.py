"""Messages for wrong arguments of a class."""

from __future__ import annotations

import inspect
from functools import wraps
from typing import Any, TypeVar

from kickdrift.errors import InputError
from kickdrift.text import suggestion

Class = TypeVar("Class", bound=type)


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
            what = str(error) if unknown is None else f"no argument {unknown!r}{suggestion(unknown, names)}"
            raise InputError(
                f"{type(self).__name__}: {what} ({type(self).__name__} takes {', '.join(names)})"
            ) from None
        initial(self, *args, **given)

    made.__init__ = init
    return cls
