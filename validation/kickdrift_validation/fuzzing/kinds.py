"""Generators of cases by the names of their kinds."""

from __future__ import annotations

from kickdrift_validation.fuzzing import archives, command_lines, flips, killed, run_files, system_files

KINDS = {each.KIND: each.case for each in (system_files, command_lines, run_files, flips, killed, archives)}
