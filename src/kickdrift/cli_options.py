"""Arguments and options that several commands share."""

from pathlib import Path
from typing import Annotated

import typer

SystemArgument = Annotated[
    str, typer.Argument(metavar="SYSTEM.toml", help="A system file, or the name of one that ships.")
]
JsonOption = Annotated[
    Path | None, typer.Option("--json", metavar="FILE", help="Write the results as one JSON object.")
]
OverwriteOption = Annotated[bool, typer.Option("--overwrite", help="Replace files that exist.")]
ThreadsOption = Annotated[int, typer.Option(metavar="K", min=1, help="Threads; the results do not depend on it.")]
QuietOption = Annotated[bool, typer.Option("--quiet", help="Nothing on standard error but errors.")]
FlushOption = Annotated[
    float | None, typer.Option(metavar="SECONDS", help="Of frames that a kill costs at most (default 10).")
]
