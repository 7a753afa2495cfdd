"""Key of a compiled function's sources: equal keys mean equal machine code.

The key covers the files of the package behind the code (see `package_files`) and everything that the user's functions
use (see `described`). It also covers the types, and the versions and settings of Python, numba, LLVM and numpy. If one
of them cannot be described, there is no key, and the code is not kept on disk.
"""

from __future__ import annotations

import hashlib
import platform
import sys
from collections.abc import Callable, Iterable, Iterator
from typing import Any

import llvmlite
import numba
import numpy as np
from numba import types

from kickdrift.jit.cache.described import Description, Text, found_by_name, settled
from kickdrift.jit.cache.package_files import NAME, UnknownSource, in_package, reach, sources_hash
from kickdrift.jit.numba_private import Intrinsic

# Types that their names describe fully.
_NAMED = (
    *(types.Number, types.Boolean, types.NoneType, types.StringLiteral),
    *(types.Array, types.CPointer, types.RawPointer),
)
# numba's settings that change the machine code, beside the processor's settings.
_SETTINGS = (
    *("OPT", "LOOP_VECTORIZE", "SLP_VECTORIZE", "USING_SVML"),
    *("BOUNDSCHECK", "DEBUGINFO_DEFAULT", "LLVM_REFPRUNE_FLAGS"),
)
# Names of functions that compiled code of the package looks up in the class of a type.
_METHODS = ("law", "pull", "apply")


def _versions() -> Text:
    versions = (platform.python_implementation(), sys.version, numba.__version__, llvmlite.__version__, np.__version__)
    return (*versions, *(repr(getattr(numba.config, name, None)) for name in _SETTINGS))


def functions_of(cls: type) -> Iterator[Any]:
    """Functions of a NamedTuple class that go into the compiled code for its instances."""
    for name in _METHODS:
        if hasattr(cls, name) and name not in getattr(cls, "_fields", ()):
            yield getattr(cls, name)
    yield from getattr(cls, "kernel_sources", ())


class Sources:
    """All sources of a compiled function.

    Attributes
    ----------
    foreign : whether a class from outside the package is among the types
    """

    def __init__(self) -> None:
        self.foreign = False
        self._description = Description()
        self._description.modules.add(f"{NAME}.jit.compile")  # all code is compiled with the options of this module
        self._texts: list[Text] = []

    def add_function(self, function: Any) -> None:
        """Add a function and everything that its code uses."""
        if in_package(function.__module__) and function.__closure__ is None:  # the files cover it fully
            self._description.modules.add(function.__module__)
            self._texts.append((function.__module__, function.__qualname__, str(function.__code__.co_firstlineno)))
            return
        self._texts.append(self._description.of(function))

    def add_made_around(self, function: Callable[..., Any], kind: types.Type) -> None:
        """Add a function of the package that closes over intrinsics of one type."""
        if not in_package(function.__module__):
            raise UnknownSource("a function from outside the package that closes over a type")
        closure = [cell.cell_contents for cell in function.__closure__ or ()]
        values = [self._description.of(value) for value in closure if not isinstance(value, Intrinsic)]
        self._description.modules.add(function.__module__)
        self._texts.append((function.__module__, function.__qualname__, *values))
        self.add_type(kind)

    def add_type(self, kind: types.Type) -> None:
        """Add a type and the functions of its classes."""
        self._texts.append(self._type(kind))

    def _type(self, kind: types.Type) -> Text:
        if isinstance(kind, types.BaseNamedTuple):
            return (*self._class(kind.instance_class), repr(kind.fields), *map(self._type, kind))
        if isinstance(kind, types.BaseTuple):
            return ("tuple", *map(self._type, kind))
        pointed_at = getattr(kind, "kind", None)
        if isinstance(pointed_at, types.Type) and in_package(type(kind).__module__):  # a handle
            return (*self._class(type(kind)), self._type(pointed_at))
        if isinstance(kind, types.Omitted):
            return ("omitted", self._description.of(kind.value))
        if isinstance(kind, _NAMED):
            return ("type", str(kind))
        raise UnknownSource(f"the type {kind}")

    def _class(self, cls: type) -> Text:
        name = (cls.__module__, cls.__qualname__)
        if in_package(cls.__module__) and found_by_name(*name) is cls:
            self._description.modules.add(cls.__module__)
        else:
            self.foreign = True
        return (*name, *(self._description.of(each) for each in functions_of(cls)))

    def key(self, processor: Any) -> str:
        """Key of the code for a processor, in numba's name for it.

        Raises
        ------
        UnknownSource
            If a file of the package was edited after this process began.
        """
        files = sources_hash(self._description.modules)
        whole = (_versions(), repr(processor), files, *self._texts)
        return hashlib.sha256(repr(whole).encode()).hexdigest()

    def cover(self, functions: Iterable[Callable[..., Any]]) -> bool:
        """Tell whether the key detects an edit of each of these functions."""
        files = reach(frozenset(self._description.modules))
        for function in functions:
            home = function.__module__
            if home is None:  # generated and executed by another function
                continue
            if in_package(home) and home not in files:
                return False
            if not in_package(home) and not settled(home) and function.__code__ not in self._description.codes:
                return False
        return True


def fingerprint(cls: type) -> str:
    """Describe a NamedTuple class as text: equal texts mean equal code, in every process."""
    sources = Sources()
    return repr((sources._class(cls), sorted(sources._description.modules)))
