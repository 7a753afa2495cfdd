"""Completion of commands, options and names in bash, zsh and fish, in these shells themselves."""

from __future__ import annotations

import os
import pty
import select
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.folders import TOP

# What is typed, and words that the shell offers.
CASES = [
    ("kickdrift mov", {"movie"}),
    ("kickdrift run --int", {"--integrator", "--interval"}),
    ("kickdrift run lj-b", {"lj-binary-1000"}),
    ("kickdrift run lj-1000 --integrator wisdom", {"wisdom-holman"}),
]


@pytest.fixture(scope="module")
def shell(tmp_path_factory):
    """Function that runs a shell's script with a program kickdrift on its path, beside the scripts for completion."""
    folder = tmp_path_factory.mktemp("shells")
    program = folder / "kickdrift"
    program.write_text(f'#!/bin/sh\nexec {sys.executable} -m kickdrift "$@"\n')
    program.chmod(0o755)
    path = os.pathsep.join((str(TOP / "src"), str(TOP / "validation")))
    environment = os.environ | {"PATH": f"{folder}:{os.environ['PATH']}", "HOME": str(folder), "PYTHONPATH": path}

    def run(name: str, script: str) -> str:
        if shutil.which(name) is None:
            pytest.skip(f"{name} is not installed")
        source = subprocess.run(
            [program], env=environment | {"_KICKDRIFT_COMPLETE": f"source_{name}"}, capture_output=True, text=True
        ).stdout
        (folder / f"source.{name}").write_text(source)
        if name == "zsh":
            return in_terminal(folder, environment, script)
        text = f"source {folder}/source.{name}\n{script}"
        return subprocess.run([name, "-c", text], env=environment, capture_output=True, text=True, cwd=folder).stdout

    return run


def in_terminal(folder: Path, environment: dict[str, str], typed: str) -> str:
    """What zsh shows when a line is typed and the tab key is pressed: zsh completes in a terminal alone."""
    pid, terminal = pty.fork()
    if pid == 0:
        os.chdir(folder)
        os.execvpe("zsh", ["zsh", "-f", "-i"], environment | {"TERM": "dumb"})

    def shown(until: str) -> str:
        found, end = "", time.monotonic() + 60
        while until not in found and time.monotonic() < end:
            if select.select([terminal], [], [], 0.1)[0]:
                found += os.read(terminal, 65536).decode(errors="replace")
        return found

    try:
        os.write(terminal, b"PS1=; autoload -Uz compinit; compinit -D; source source.zsh; echo re''ady\n")
        assert "ready" in shown("ready")
        os.write(terminal, typed.encode() + b"\t\x0b")
        word = next(iter(dict(CASES)[typed]))
        return shown(word)
    finally:
        os.kill(pid, 9)
        os.waitpid(pid, 0)
        os.close(terminal)


@pytest.mark.long
@pytest.mark.parametrize(("typed", "offered"), CASES)
def test_bash_completes(typed, offered, shell):
    words = typed.split()
    script = f"COMP_WORDS=({typed}); COMP_CWORD={len(words) - 1}; _kickdrift_completion kickdrift; "
    assert {*shell("bash", script + 'printf "%s\\n" "${COMPREPLY[@]}"').split()} == offered


@pytest.mark.long
@pytest.mark.parametrize(("typed", "offered"), CASES)
def test_fish_completes(typed, offered, shell):
    lines = shell("fish", f'complete -C "{typed}"').splitlines()
    assert {line.split("\t")[0] for line in lines} == offered


@pytest.mark.long
@pytest.mark.parametrize(("typed", "offered"), [case for case in CASES if len(case[1]) == 1])
def test_zsh_completes(typed, offered, shell):
    assert next(iter(offered)) in shell("zsh", typed)
