"""Generators of cases by the names of their kinds."""

from __future__ import annotations

from kickdrift_validation.fuzzing import command_lines, flips, killed, more_commands, run_files, system_files, tables

KINDS = {
    each.KIND: each.case for each in (system_files, command_lines, run_files, flips, killed, tables, more_commands)
}
