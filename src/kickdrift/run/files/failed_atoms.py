"""The particles at which a force's Python code failed, in a file beside the run's file."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from kickdrift.disk.outputs import reason
from kickdrift.errors import RunError
from kickdrift.integrators.flows.particle_flow import ParticleFlow
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.model.units.file_units import Scale
from kickdrift.run.advance import Integration


@contextmanager
def keeping_failed_atoms(run: Integration, output: str | None) -> Iterator[None]:
    """If a function or calculator fails in the run, write its particles beside ``output``, and name that file in the
    error's line. Without output there is no such file."""
    try:
        yield
    except RunError as error:
        flow: Any = run.moving
        if output is not None and error.failed_at is not None and isinstance(flow, ParticleFlow):
            for host in flow.forces.hosts:
                if host is not None and host.failure:
                    places = host.positions / host.parts.scale
                    error.args = (f"{error}; {_written(run.system, places, error.failed_at, Path(output))}",)
                    break
        raise


def _written(system: Any, places: Floats, at: tuple[int, float], output: Path) -> str:
    """Write the file; return what became of it."""
    name = f"{output.stem}-step-{at[0]}"
    names = [output.with_name(f"{name}{more}.extxyz") for more in ("", *(f"-{k}" for k in range(2, 100)))]
    path = next((each for each in names if not each.exists()), names[-1])
    try:
        path.write_text(extxyz(system, places, at))
    except OSError as error:
        return f"its particles could not be written to {path}: {reason(error)}"
    return f"its particles are in {path}"


def extxyz(system: System, places: Floats, at: tuple[int, float]) -> str:
    """Text of an extended XYZ file of particles at ``places`` (n, 3), with all digits; in angstrom if the units can be
    converted. A space in the name of a species becomes an underscore."""
    scale = Scale.of(system.units).length
    step, time = at
    edges = " ".join(repr(float(edge)) for edge in (system.box.matrix / scale).flat)
    axes = " ".join("T" if periodic else "F" for periodic in system.box.periodic_axes)
    lattice = f'Lattice="{edges}" ' if system.box.periodic else ""
    head = f'{lattice}Properties=species:S:1:pos:R:3 pbc="{axes}" step={step} time={time!r}'
    rows = [
        f"{'_'.join(system.species[kind].split())} {float(x)!r} {float(y)!r} {float(z)!r}"
        for kind, (x, y, z) in zip(system.species_index, places / scale, strict=True)
    ]
    return "\n".join([str(len(rows)), head, *rows, ""])
