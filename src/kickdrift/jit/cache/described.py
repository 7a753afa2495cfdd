"""Keys of compiled functions' sources, and descriptions of users' functions: equal texts mean equal machine code.

The key covers the files of the package behind the code (see `package_files`) and everything that the user's functions
use: global variables, closures, defaults, attributes of modules and classes, other functions, and in turn their
sources. It also covers the types, and the versions and settings of Python, numba, LLVM and numpy. A value without a
stable description (an object known only by its memory address) raises `UnknownSource`. There is then no key, and the
code is not kept on disk.
"""

import builtins
import dis
import enum
import hashlib
import inspect
import os
import platform
import sys
import sysconfig
from abc import ABCMeta
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from types import BuiltinFunctionType, CodeType, FunctionType, ModuleType
from typing import Any, ClassVar

import llvmlite
import numba
import numpy as np
from numba import types

from kickdrift.jit.cache.package_files import NAME, UnknownSource, in_package, reach, sources_hash
from kickdrift.jit.numba_private import CPUDispatcher, Intrinsic, builtin_registry

PLAIN = (bool, int, float, complex, str, bytes, type(None), type(...), type(NotImplemented), range)
NUMBERS = (types.Number, types.Boolean, types.NoneType)
_STDLIB = os.path.join(os.path.realpath(sysconfig.get_path("stdlib")), "")
_LIBRARIES = {each.__name__: each for each in (np, numba, llvmlite)}

Text = tuple[Any, ...]  # strings and nested tuples of strings, so that its repr has one meaning


@cache
def settled(name: str | None) -> bool:
    """Tell whether a module belongs to Python, numpy or numba, so that its version describes it fully."""
    root = (name or "").partition(".")[0]
    module = sys.modules.get(root)
    if root in sys.builtin_module_names or module is None:
        return root in sys.builtin_module_names
    if root in _LIBRARIES:
        return module is _LIBRARIES[root]
    path = os.path.realpath(getattr(module, "__file__", None) or "")
    return path.startswith(_STDLIB) and not {"site-packages", "dist-packages"} & set(path.split(os.sep))


def found_by_name(module: str | None, qualname: str | None) -> Any:
    """Object of that name in a module, or None."""
    value: Any = sys.modules.get(module or "")
    for part in (qualname or "").split("."):
        value = getattr(value, part, None)
    return value


def _codes(code: CodeType) -> Iterable[CodeType]:
    """A function's code and the code of all functions inside."""
    yield code
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _codes(constant)


@cache
def _names(code: CodeType) -> tuple[frozenset[str], frozenset[str]]:
    """Global names that code uses, and names of attributes that it may use (also by `getattr`)."""
    names: set[str] = set()
    attributes: set[str] = set()
    for each in _codes(code):
        attributes |= {text for text in each.co_consts if isinstance(text, str) and text.isidentifier()}
        for step in dis.get_instructions(each):
            if step.opcode in dis.hasname:
                by_attribute = "ATTR" in step.opname or "METHOD" in step.opname
                (attributes if by_attribute else names).add(str(step.argval))
    return frozenset(names), frozenset(attributes)


class Description:
    """Describe values, and record the functions and modules of the package that they use.

    Attributes
    ----------
    modules : modules of the package whose files must be read
    codes : code of the described functions
    """

    def __init__(self) -> None:
        self.modules: set[str] = set()
        self.codes: set[CodeType] = set()
        self._seen: dict[Any, tuple[int, Any]] = {}  # keeps the values too, so that their ids stay unique
        self._registered: dict[Any, list[Any]] | None = None

    def of(self, value: Any, names: frozenset[str] = frozenset()) -> Text:
        """Describe a value as text; for a module or a class, only the attributes with these names."""
        if type(value) in PLAIN:
            return (type(value).__name__, hex(value) if type(value) is int else repr(value))
        if isinstance(value, np.generic):
            return ("number", *self._array(np.asarray(value)))
        key = (id(value), names if isinstance(value, ModuleType | type) else None)
        if key in self._seen:
            return ("again", str(self._seen[key][0]))
        self._seen[key] = len(self._seen), value
        for kinds, describe in self._KINDS:
            if isinstance(value, kinds):
                return describe(self, value, names)
        raise UnknownSource(f"a {type(value).__qualname__}")

    def _array(self, value: np.ndarray) -> Text:
        if type(value) not in (np.ndarray, np.memmap) or value.dtype.hasobject:
            raise UnknownSource(f"an array of {value.dtype}")
        layout = f"{value.shape} {value.strides} {value.flags.writeable} {value.flags.aligned}"
        return ("array", repr(value.dtype), layout, hashlib.sha256(value.tobytes()).hexdigest())

    def _container(self, value: Any) -> Text:
        kind = type(value)
        if kind in (set, frozenset):
            if not all(type(each) in PLAIN for each in value):
                raise UnknownSource("a set of objects")
            return (kind.__name__, *sorted(self.of(each) for each in value))
        items = [part for pair in value.items() for part in pair] if isinstance(value, dict) else value
        if kind in (tuple, list, dict):
            return (kind.__name__, *(self.of(each) for each in items))
        if isinstance(value, tuple) and hasattr(kind, "_fields"):
            return ("named", self.of(kind), *(self.of(each) for each in value))
        raise UnknownSource(f"a {kind.__qualname__}")

    def _module(self, value: ModuleType, names: frozenset[str]) -> Text:
        if settled(value.__name__) and sys.modules.get(value.__name__) is value:
            return ("settled", value.__name__)
        missing = object()
        found = [(name, getattr(value, name, missing)) for name in sorted(names)]
        return ("module", *((name, self.of(what, names)) for name, what in found if what is not missing))

    def _class(self, value: type, names: frozenset[str]) -> Text:
        name = (value.__module__, value.__qualname__)
        if settled(value.__module__) and found_by_name(*name) is value:
            return ("settled", *name)
        if in_package(value.__module__) and found_by_name(*name) is value:
            self.modules.add(value.__module__)
            return ("package", *name)
        if type(value) not in (type, ABCMeta, enum.EnumMeta):
            raise UnknownSource(f"a class of the kind {type(value).__qualname__}")
        if isinstance(value, enum.EnumMeta):
            members = [(key, self.of(value[key].value, names)) for key in value.__members__]
            return ("enum", *name, *(self.of(base, names) for base in value.__bases__), *members)
        fields = [self.of(getattr(value, key, None)) for key in ("_fields", "_field_defaults")]
        own = [(key, self._member(vars(value)[key], names)) for key in sorted(names) if key in vars(value)]
        return ("class", *name, *fields, *(self.of(base, names) for base in value.__bases__), *own)

    def _member(self, value: Any, names: frozenset[str]) -> Text:
        if isinstance(value, staticmethod | classmethod):
            return (type(value).__name__, self.of(value.__func__))
        if isinstance(value, property):
            return ("property", *(self.of(each) for each in (value.fget, value.fset, value.fdel)))
        if inspect.isdatadescriptor(value):  # a field of a NamedTuple, a slot
            return ("field",)
        return self.of(value, names)

    def _compiled(self, value: Any) -> Text:
        """Describe a function that numba compiles, with its options and its explicit types."""
        locked = () if value._can_compile else tuple(map(str, value.nopython_signatures))
        pipeline = value._compiler.pipeline_class
        if not (settled(pipeline.__module__) or in_package(pipeline.__module__)):
            raise UnknownSource("a compiler of another's")
        options = (self.of(value.targetoptions), repr(sorted(map(str, value.locals.items()))))
        kind = f"{type(value).__qualname__} {pipeline.__qualname__}"
        return ("compiled", kind, *options, *locked, self.of(value.py_func))

    def _intrinsic(self, value: Any) -> Text:
        return ("intrinsic", str(value._prefer_literal), self.of(value._ctor_kwargs), self.of(value._defn))

    def _function(self, value: FunctionType) -> Text:
        name = (value.__module__, value.__qualname__)
        closed = tuple(self._cell(cell) for cell in value.__closure__ or ())
        defaults = (self.of(value.__defaults__), self.of(value.__kwdefaults__))
        if in_package(value.__module__):
            self.modules.add(value.__module__)
            if not value.__code__.co_filename.startswith("<"):  # then the file covers the rest
                return ("package", *name, str(value.__code__.co_firstlineno), *closed, *defaults)
        overloads = self._overloads(value)
        if settled(value.__module__) and found_by_name(*name) is value:
            return ("settled", *name, *overloads)
        self.codes.update(_codes(value.__code__))
        names, attributes = _names(value.__code__)
        used = []
        for key in sorted(names):
            for scope in (value.__globals__, vars(builtins)):
                if key in scope:
                    used.append((key, self.of(scope[key], attributes)))
                    break
        asked = [each for name in sorted(attributes) for each in self._overloads(name)]
        return ("function", self._code(value.__code__), *closed, *defaults, *used, *asked, *overloads)

    def _code(self, code: CodeType) -> Text:
        constants = [self._code(each) if isinstance(each, CodeType) else self.of(each) for each in code.co_consts]
        counts = (code.co_argcount, code.co_posonlyargcount, code.co_kwonlyargcount, code.co_flags)
        names = (code.co_names, code.co_varnames, code.co_cellvars, code.co_freevars)
        return ("code", code.co_code.hex(), code.co_exceptiontable.hex(), repr(counts), repr(names), *constants)

    def _cell(self, cell: Any) -> Text:
        try:
            return self.of(cell.cell_contents)
        except ValueError:
            return ("empty",)

    def _builtin(self, value: Any) -> Text:
        overloads = self._overloads(value)
        name = getattr(value, "__name__", "")
        home = "numpy" if isinstance(value, np.ufunc) else value.__module__
        if not (settled(home) and found_by_name(home, name) is value):
            raise UnknownSource(f"the function {name}")
        return ("settled", str(home), name, *overloads)

    def _overloads(self, what: Any) -> tuple[Text, ...]:
        """Describe what user code registers with numba for a function, or for an attribute's name."""
        if self._registered is None:
            self._registered = _registrations()
        of_name = isinstance(what, str)
        found = []
        for kind in self._registered.get(what if of_name else id(what), ()):
            body = kind._overload_func
            if in_package(body.__module__):
                self.modules.add(body.__module__)
            elif not (settled(body.__module__) and (of_name or settled(getattr(what, "__module__", None)))):
                options = (getattr(kind, "_jit_options", None), kind.prefer_literal, str(kind._inline.value))
                found.append(("overload", *map(self.of, options), self.of(body)))
        return tuple(found)

    # The first matching kind counts.
    _KINDS: ClassVar[list[tuple[Any, Callable[[Any, Any, frozenset[str]], Text]]]] = [
        (np.ndarray, lambda self, value, names: self._array(value)),
        (np.dtype, lambda self, value, names: ("dtype", repr(value))),
        (CPUDispatcher, lambda self, value, names: self._compiled(value)),
        (Intrinsic, lambda self, value, names: self._intrinsic(value)),
        (FunctionType, lambda self, value, names: self._function(value)),
        ((BuiltinFunctionType, np.ufunc), lambda self, value, names: self._builtin(value)),
        (ModuleType, _module),
        (type, _class),
        (enum.Enum, lambda self, value, names: ("member", self.of(type(value)), value.name, self.of(value.value))),
        (NUMBERS, lambda self, value, names: ("type", str(value))),
        ((tuple, list, dict, set, frozenset), lambda self, value, names: self._container(value)),
    ]


def _registrations() -> dict[Any, list[Any]]:
    """numba's overloads in Python: by the `id` of the function, or by the name of the attribute."""
    found: dict[Any, list[Any]] = {}
    functions = [(id(key), kind) for key, of in builtin_registry.globals for kind in getattr(of, "templates", ())]
    for key, kind in [*functions, *((getattr(kind, "_attr", None), kind) for kind in builtin_registry.attributes)]:
        if hasattr(kind, "_overload_func"):
            found.setdefault(key, []).append(kind)
    return found


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
