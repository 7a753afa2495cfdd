"""The files that commands are asked to write: looked at before any work is done, and written whole or not at all."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from kickdrift.errors import InputError, RunError
from kickdrift.report import plain

SUFFIXES = {"output": (".h5md",), "plot": (".png", ".pdf", ".svg")}  # as the writers of these files have them


def refuse_outputs(paths: dict[str, Path | None], overwrite: bool) -> None:
    """An InputError where a file that an option asks for exists, or cannot be written, before any work is done."""
    taken: dict[Path, str] = {}
    for option, path in paths.items():
        if path is None:
            continue
        folder = path.absolute().parent
        if path.suffix not in SUFFIXES.get(option, (path.suffix,)):
            raise InputError(f"--{option} {path}: the name must end in {' or '.join(SUFFIXES[option])}")
        if path.is_dir():
            raise InputError(f"--{option} {path}: is a folder")
        if path.exists() and not overwrite:
            raise InputError(f"--{option} {path}: exists already; give --overwrite to replace it")
        if not folder.is_dir():
            raise InputError(f"--{option} {path}: there is no folder {folder}")
        if other := taken.get(path.resolve()):
            raise InputError(f"--{option} {path}: is the file of --{other} too")
        taken[path.resolve()] = option
        try:
            with tempfile.TemporaryFile(dir=folder):
                pass
        except OSError as error:
            raise InputError(f"--{option} {path}: cannot be written: {reason(error)}") from None


def reason(error: OSError) -> str:
    """Why the system refused."""
    return (error.strerror or str(error)).lower()


def checked_target(output: str | os.PathLike[str], what: str, suffixes: Collection[str], overwrite: bool) -> Path:
    """The path of a file to be written; an InputError where its name is wrong, it exists or its folder does not."""
    path = Path(output)
    if path.suffix.lower() not in suffixes:
        raise InputError(f"{path}: {what} must end in {', '.join(suffixes)}")
    if not path.parent.is_dir():
        raise InputError(f"{path}: there is no folder {path.parent}")
    if path.is_dir():
        raise InputError(f"{path}: is a folder")
    if path.exists() and not overwrite:
        raise InputError(f"{path}: exists already; pass --overwrite (overwrite=True) to replace it")
    return path


@contextmanager
def written_whole(path: Path, *, overwrite: bool = True) -> Iterator[Path]:
    """A name beside ``path`` to write to, which takes its place at the end; after an error there is nothing new."""
    part = path.with_name(f".{path.stem}.{os.getpid()}.part{path.suffix}")
    try:
        yield part
        if path.exists() and not overwrite:
            raise InputError(f"{path}: exists by now; pass --overwrite (overwrite=True) to replace it")
        os.replace(part, path)
    except OSError as error:
        raise RunError(f"{path}: cannot be written: {reason(error)}") from None
    finally:
        part.unlink(missing_ok=True)


def write_json(path: Path | None, content: dict[str, Any]) -> None:
    """One JSON object, where it was asked for; the file is whole or not there."""
    if path is not None:
        with written_whole(path) as part:
            part.write_text(json.dumps(plain(content), indent=2, allow_nan=False) + "\n", encoding="utf-8")
