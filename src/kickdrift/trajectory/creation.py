"""A run's file comes into being whole or not at all, and an old one is replaced only by a whole new one."""

from __future__ import annotations

from pathlib import Path

from kickdrift.disk import kinds
from kickdrift.disk.files import shown_path
from kickdrift.disk.kinds import Kind
from kickdrift.disk.outputs import checked_target, reason, settle
from kickdrift.disk.parts import private_place
from kickdrift.errors import InputError
from kickdrift.trajectory.openfile import identity
from kickdrift.trajectory.storage import refuse_in_use


def create(path: Path, image: bytes, *, overwrite: bool, kind: Kind = kinds.RUN) -> tuple[int, int]:
    """Write ``image`` to a new file and return its device and inode; an InputError says why that cannot be, and then
    nothing has changed."""
    checked_target(path, kind, overwrite)
    try:
        if overwrite:
            refuse_in_use(path)
        with private_place(path) as part:
            part.write_bytes(image)
            own = identity(part)
            settle(part, path, kind, overwrite=overwrite)
    except OSError as error:
        raise InputError(f"{shown_path(path)}: cannot be written: {reason(error)}") from None
    return own
