"""One build of kickdrift for against.py: a process that runs on command, and answers with how far it came.

    python build.py GROUPS GROUP CONTESTANT

GROUPS is the module of the build's groups. The program runs as its own file, so it can time commits in which these
scripts were no package.
"""

import json
import os
import sys
from importlib import import_module
from time import perf_counter, process_time


def main(groups: str, group_name: str, contestant_name: str) -> None:
    """Read amounts from standard input and run them; write amounts and seconds to standard output."""
    out = os.fdopen(os.dup(1), "w", buffering=1, encoding="utf-8")
    os.dup2(2, 1)
    entries = import_module(groups).ENTRIES
    group = next(entry for entry in entries if entry.name == group_name and hasattr(entry, "contestants"))
    contestant = next(each for each in group.contestants if each.name == contestant_name)
    clock = process_time if group.threads == 1 else perf_counter
    runner = contestant.make(group.start())
    print(json.dumps([runner.least]), file=out)
    for line in sys.stdin:
        began = clock()
        done = runner.run(float(line))
        print(json.dumps([done, clock() - began]), file=out)


if __name__ == "__main__":
    main(*sys.argv[1:])
