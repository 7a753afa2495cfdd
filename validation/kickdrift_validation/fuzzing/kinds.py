"""Generators of cases by the names of their kinds."""

from __future__ import annotations

from kickdrift_validation.fuzzing import (
    archives,
    command_lines,
    dicts,
    flips,
    hosts,
    killed,
    lammps_data,
    run_files,
    system_files,
)

INPUTS = (archives, hosts, lammps_data, dicts)  # other inputs than the program's own files
KINDS = {each.KIND: each.case for each in (system_files, command_lines, run_files, flips, killed, *INPUTS)}
