"""The package's own source files: their content, and the files behind a module's code.

A module's code can come from the module's file and from every file of the package that it imports, directly or not. The
imports are read from the text, wherever they stand in the file. This imports no module and reads only the needed files:
about a millisecond for a step loop.
"""

import hashlib
import os
import re
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

PACKAGE = Path(__file__).parents[2]
NAME = __name__.partition(".")[0]

# An import of the package by itself.
_IMPORT = re.compile(
    rf"\n[ \t]*(?:from[ \t]+({NAME}[\w.]*)[ \t]+import[ \t]*(\((?:[^)#]|#[^\n]*)*\)|[^\n]*)|import[ \t]+([^\n]*))"
)
_FOR_TYPE_CHECKERS = re.compile(r"\nif TYPE_CHECKING:\n(?:[ \t][^\n]*\n|\n)*")
_COMMENT = re.compile(r"#[^\n]*")


class UnknownSource(Exception):
    """A value whose equal descriptions do not mean equal code. Code that uses it is not kept on disk."""


class _File(NamedTuple):
    path: str
    stamp: tuple[int, ...]


def _stamp(found: os.stat_result) -> tuple[int, ...]:
    return found.st_mtime_ns, found.st_size, found.st_ino


def _files(folder: str | Path, package: str) -> Iterator[tuple[str, _File]]:
    """Every module in a package's folder with its present file."""
    with os.scandir(folder) as entries:
        for entry in entries:
            stem, suffix = os.path.splitext(entry.name)
            if suffix == ".py":
                yield package if stem == "__init__" else f"{package}.{stem}", _File(entry.path, _stamp(entry.stat()))
            elif not suffix and stem != "__pycache__" and entry.is_dir():
                yield from _files(entry.path, f"{package}.{stem}")


# Stamps of the files when this process began to compile. The process does not run later edits.
_FILES = dict(_files(PACKAGE, NAME))


def in_package(module: str | None) -> bool:
    """Tell whether a module belongs to the package."""
    return module is not None and (module == NAME or module.startswith(f"{NAME}."))


def imports(text: str) -> set[tuple[str, str]]:
    """Imports of the package in a file's text: (module, name in the module, or "" for the module alone)."""
    found: set[tuple[str, str]] = set()
    for base, names, plain in _IMPORT.findall(_FOR_TYPE_CHECKERS.sub("\n", "\n" + text)):
        words = _COMMENT.sub("", names or plain).strip("() \t\r\n").split(",")
        listed = [word.split()[0] for word in words if word.split()]
        found |= {(base, name) for name in listed} if base else {(name, "") for name in listed}
    return {(module, name) for module, name in found if in_package(module)}


def _module(base: str, name: str = "") -> str:
    """Module that holds a name of ``base``: the submodule of that name, if there is one."""
    if f"{base}.{name}" in _FILES:
        return f"{base}.{name}"
    if base not in _FILES:
        raise UnknownSource(f"{base} has no source file")
    return base


@cache
def _read(module: str) -> tuple[str, frozenset[str]]:
    """Hash of a module's file, and the modules that the file may import."""
    try:
        content = Path(_FILES[module].path).read_bytes()
    except OSError:
        raise UnknownSource(f"{module} cannot be read") from None
    return hashlib.sha256(content).hexdigest(), frozenset(_module(*each) for each in imports(content.decode()))


@cache
def reach(modules: frozenset[str]) -> tuple[str, ...]:
    """Modules of the package that can contribute to these modules' code, sorted."""
    found: set[str] = set()
    waiting = [_module(name) for name in modules]
    while waiting:
        module = waiting.pop()
        if module not in found:
            found.add(module)
            waiting += _read(module)[1]
    return tuple(sorted(found))


@cache
def _hash(modules: tuple[str, ...]) -> str:
    return hashlib.sha256("".join(f"{name} {_read(name)[0]}\n" for name in modules).encode()).hexdigest()


def sources_hash(modules: Iterable[str]) -> str:
    """Hash of every file of the package that can contribute to these modules' code.

    Raises
    ------
    UnknownSource
        If a file was edited after this process began.
    """
    reached = reach(frozenset(modules))
    for module in reached:
        path, stamp = _FILES[module]
        try:
            now = _stamp(os.stat(path))
        except OSError:
            now = ()
        if now != stamp:
            raise UnknownSource(f"{path} was edited while this process ran")
    return _hash(reached)
