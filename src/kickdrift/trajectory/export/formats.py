"""Formats to which a run can be exported, and what each format keeps: one table for the program and its page."""

from __future__ import annotations

from typing import NamedTuple


class Format(NamedTuple):
    """A format and the form in which it keeps each quantity; an empty text says that the quantity is lost."""

    suffix: str
    used_by: str
    package: str
    positions: str
    velocities: str = ""
    box: str = ""
    times: str = ""
    steps: str = ""
    masses: str = ""
    names: str = ""
    bonds: str = ""
    nominal_positions: str = ""  # if different for nominal units
    removed: str = ""  # bodies that were removed during the run; an empty text refuses such a run
    single: bool = False  # whether a file holds one frame


KEPT = ("positions", "velocities", "box", "times", "steps", "masses", "names", "bonds")
LOST_BY_ALL = "forces, observables, events and restarts"
REMOVED_NAN = "as NaN"
REMOVED_LEFT_OUT = "left out from then on"

FORMATS: dict[str, Format] = {
    format.suffix: format
    for format in (
        Format(
            ".dcd",
            "CHARMM, NAMD, LAMMPS, VMD",
            "MDAnalysis",
            positions="float32",
            box="float32",
            times="one spacing, float32",
            steps="one spacing",
            removed=REMOVED_NAN,
        ),
        Format(
            ".xtc",
            "GROMACS, VMD",
            "MDAnalysis",
            positions="multiples of 0.01 angstrom",
            nominal_positions="multiples of 0.0001",
            box="float32",
            times="float32",
            steps="int32",
        ),
        Format(
            ".trr",
            "GROMACS, VMD",
            "MDAnalysis",
            positions="float32",
            velocities="float32",
            box="float32",
            times="float32",
            steps="int32",
            removed=REMOVED_NAN,
        ),
        Format(
            ".xyz",
            "almost everything",
            "MDAnalysis",
            positions="float32, 8 decimals",
            times="in the comment line",
            steps="in the comment line",
            names="without spaces",
            removed=REMOVED_NAN,
        ),
        Format(
            ".pdb",
            "viewers",
            "MDAnalysis",
            positions="3 decimals",
            box="3 decimals",
            names="first 4 letters",
            bonds="CONECT records",
        ),
        Format(
            ".extxyz",
            "ASE, OVITO",
            "ASE",
            positions="8 decimals",
            velocities="8 decimals",
            box="float64",
            times="float64",
            steps="int64",
            masses="8 decimals",
            names="in the comment line",
            removed=REMOVED_LEFT_OUT,
        ),
        Format(
            ".traj",
            "ASE",
            "ASE",
            positions="float64",
            velocities="float64, of bodies with a mass",
            box="float64",
            times="float64",
            steps="int64",
            masses="float64",
            names="in info",
            removed=REMOVED_LEFT_OUT,
        ),
        Format(
            ".data",
            "LAMMPS, MDAnalysis, ASE, OVITO, kickdrift",
            "kickdrift",
            positions="float64, one frame",
            velocities="float64",
            box="float64",
            times="in the first line",
            steps="in the first line",
            masses="float64",
            names="species in comments",
            bonds="all lists with types",
            removed=REMOVED_LEFT_OUT,
            single=True,
        ),
        Format(
            ".bin",
            "rebound, as a Simulationarchive",
            "rebound",
            positions="float64",
            velocities="float64",
            times="float64",
            steps="int64",
            masses="float64",
            names="each body's",
            removed=REMOVED_LEFT_OUT,
        ),
    )
}


def losses(format: Format, nominal: bool) -> str:
    """One line that says what an export keeps and what it loses; ``nominal`` says which units the run has."""
    ways = {what: getattr(format, what) for what in KEPT}
    if nominal and format.nominal_positions:
        ways["positions"] = format.nominal_positions
    kept = [f"{what} ({how})" for what, how in ways.items() if how]
    lost = [what for what, how in ways.items() if not how]
    return f"{format.suffix} keeps {', '.join(kept)}; loses {', '.join([*lost, LOST_BY_ALL])}"


def table() -> list[list[str]]:
    """The formats as rows of text: a heading, then a row for each format. An empty cell means that the quantity is
    lost."""
    rows = [["", "through", "read by", *KEPT, "removed bodies"]]
    for format in FORMATS.values():
        kept = [getattr(format, what) for what in KEPT]
        if format.nominal_positions:
            kept[0] += f"; {format.nominal_positions} in nominal units"
        rows.append([format.suffix, format.package, format.used_by, *kept, format.removed or "refused"])
    return rows
