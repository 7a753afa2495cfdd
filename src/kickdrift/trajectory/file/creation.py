"""Creation of a run's file: whole or not at all. Only a whole new file replaces an old file."""

from pathlib import Path

from kickdrift.disk import kinds
from kickdrift.disk.files import shown_path
from kickdrift.disk.kinds import Kind
from kickdrift.disk.outputs import checked_target, private_place, reason, settle
from kickdrift.errors import InputError
from kickdrift.trajectory.file.openfile import identity
from kickdrift.trajectory.file.storage import refuse_in_use


def create(path: Path, image: bytes, *, overwrite: bool, kind: Kind = kinds.RUN) -> tuple[int, int]:
    """Write ``image`` to a new file and return its device and inode. Raises an InputError with the reason if that
    fails; then nothing has changed."""
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
