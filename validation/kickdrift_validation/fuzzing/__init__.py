"""Cases that try to break kickdrift: system files, command lines, run files, flipped bytes, kills, tables of ensembles.

A generator (`system_files`, `command_lines`, `run_files`, `flips`) is a pure function of a seed and a number, so that
case k is the same case on every run. `zygote` runs cases, each in a process of its own that it forks, `rules` says what
a case may not do, and `session` keeps several zygotes busy.
``python -m kickdrift_validation.fuzzing KIND NUMBER`` repeats one case.
"""
