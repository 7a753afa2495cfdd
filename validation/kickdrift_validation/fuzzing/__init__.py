"""Cases that try to break kickdrift: files of many kinds, command lines, flipped bytes, kills, dicts and tables.

A generator (a module of `kinds`) is a pure function of a seed and a number, so that case k is the same case on every
run. `zygote` runs cases, each in a process of its own that it forks, `rules` says what a case may not do, and `session`
keeps several zygotes busy.
``python -m kickdrift_validation.fuzzing KIND NUMBER`` repeats one case.
"""
