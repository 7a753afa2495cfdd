"""Commands in one process, in a terminal of 80 columns or without a terminal."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections.abc import Sequence

# Runs every command of a JSON list in one process, and ends each output with a line that nothing else prints.
SCRIPT = """
import json, os, sys
from kickdrift.analysis.compare import bench, ladder
from kickdrift.cli.main import main
bench.EQUILIBRATION_TIME, ladder.RUNGS = 0.1, 5  # a short benchmark and a short comparison
for words in json.loads(sys.argv[1]):
    sys.argv = ["kickdrift", *words]
    try:
        main()
    except SystemExit as ended:
        sys.stderr.flush()
        print(f"=== {ended.code}", flush=True)
"""
CODES = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")  # that steer a terminal
END = re.compile(r"^=== (\d+)\r?\n", re.MULTILINE)


def outputs(commands: Sequence[Sequence[str]], columns: int | None, cwd: str | os.PathLike[str]) -> list[str]:
    """What each command shows in a terminal of so many columns; without ``columns``, its piped standard output.

    Raises AssertionError if a command does not end with exit status 0.
    """
    command = [sys.executable, "-c", SCRIPT, json.dumps(commands)]
    if columns is None:
        text = subprocess.run(command, capture_output=True, text=True, cwd=cwd, check=True).stdout
    else:
        text = _terminal(command, columns, cwd)
    parts = END.split(text)
    for words, status, shown in zip(commands, parts[1::2], parts[0:-1:2], strict=True):
        assert status == "0", (words, status, shown)
    return [each.replace("\r\n", "\n") for each in parts[0:-1:2]]


def _terminal(command: Sequence[str], columns: int, cwd: str | os.PathLike[str]) -> str:
    import fcntl
    import pty
    import struct
    import termios

    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 40, columns, 0, 0))
    environment = {key: value for key, value in os.environ.items() if key != "COLUMNS"} | {"TERM": "xterm"}
    running = subprocess.Popen(command, stdin=theirs, stdout=theirs, stderr=theirs, cwd=cwd, env=environment)
    os.close(theirs)
    found = b""
    while True:
        try:
            piece = os.read(ours, 65536)
        except OSError:  # the program has ended
            break
        if not piece:
            break
        found += piece
    os.close(ours)
    running.wait(timeout=60)
    return CODES.sub("", found.decode("utf-8"))
