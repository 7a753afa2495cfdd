"""Generators of cases by the names of their kinds."""

from kickdrift_validation.fuzzing import (
    archives,
    command_lines,
    dicts,
    flips,
    hosts,
    killed,
    lammps_data,
    more_commands,
    run_files,
    system_files,
    tables,
)

INPUTS = (archives, hosts, lammps_data, dicts, tables)  # other inputs than system files and run files
COMMANDS = (command_lines, more_commands)
KINDS = {each.KIND: each.case for each in (system_files, *COMMANDS, run_files, flips, killed, *INPUTS)}
