"""Command lines of every command, option and argument that the program has, with values that nobody wants."""

import random
from functools import cache
from typing import Any

from kickdrift_validation.fuzzing.case import NUMBERS, TEXTS, Case, dice

KIND = "command-lines"
# Inputs that every case finds; `session` makes those that are no plain files: see `places`.
SYSTEMS = ("two-body", "ode-harmonic", "lj.toml", "spring-net", "s.toml")
RUNS = ("bodies.h5md", "liquid.h5md", "unfinished.h5md")
OTHERS = ("broken.toml", "text.txt", "empty", "folder", "pipe", "loop", "link.toml", "missing.toml", "missing.h5md",
          "no/such/folder/x.h5md", "/dev/null", "/dev/zero", "", ".", "..", "n" * 300, "n" * 300 + ".h5md",
          "table.parquet", "bad\udcff.toml", "run.h5", "é\x1b[1m.toml", "text.h5md", "folder/x.h5md/y",
          "/proc/self/mem", "old.json")  # fmt: skip
OUTPUTS = ("new{0}", "old{0}", "folder{0}", "folder", "loop", "pipe", "/dev/null", "text.txt", "s.toml", "bodies.h5md",
           "link.toml", "n" * 300 + "{0}", "bad\udcff{0}", "no/such/x{0}", "", "é {0}", "old.json",
           "new.json")  # fmt: skip
SUFFIXES = {"output": (".h5md", ".png", ".parquet", ".dcd", ".xyz"), "json_file": (".json",), "plot": (".png", ".svg")}
NAMES = ("velocity-verlet", "rk4", "leapfrog", "dop853", "wisdom-holman", "yoshida4", "no-such-method", "rk45")
SHARES = {"run": 30, "resume": 14, "info": 10, "export": 14, "plot": 8, "chaos": 4, "compare": 4, "ensemble": 8,
          "list": 3, "show": 3,
          "bench lj-energy": 2, "bench speed": 1, "validate": 2}  # fmt: skip
OURS = frozenset({"bodies.h5md", "liquid.h5md", "unfinished.h5md", "old.h5md", "old.json", "old.png"})


@cache
def commands() -> dict[str, list[Any]]:
    """The parameters of every command, as typer has them."""
    import typer

    from kickdrift.cli import main as cli

    found: dict[str, list[Any]] = {}

    def walk(command: Any, name: str) -> None:
        if hasattr(command, "commands"):
            for word, inner in command.commands.items():
                walk(inner, f"{name} {word}".strip())
        else:
            found[name] = [each for each in command.params if each.name != "help"]

    walk(typer.main.get_command(cli.app), "")
    return found


def is_argument(parameter: Any) -> bool:
    return "Argument" in type(parameter).__name__


def kind_of(parameter: Any) -> str:
    """What is expected, in words: of click's parameters, or of those of typer's own copy."""
    kind = getattr(parameter, "type", None)
    return repr(getattr(parameter, "type_descriptor", None) if kind is None else kind).lower()


def value(rng: random.Random, command: str, parameter: Any) -> str:
    """Something to give for a parameter: half of the time a plausible value."""
    name, kind = parameter.name, kind_of(parameter)
    if name in ("output", "json_file", "plot"):
        if rng.random() < 0.5:
            return "new" + rng.choice(SUFFIXES.get(name, (".png",)))
        return rng.choice(OUTPUTS).format(rng.choice(SUFFIXES.get(name, (".x",))))
    if rng.random() < 0.1:
        return rng.choice((*TEXTS, *OTHERS))
    if name == "trajectories":
        return rng.choice(("new", "folder", "text.txt", "pipe", "loop", "no/such"))
    if name in ("system", "file"):
        good = SYSTEMS if name == "system" else (*RUNS, "two-body") if command == "info" else RUNS
        return rng.choice(good if rng.random() < 0.6 else OTHERS)
    if name in ("kind", "what"):
        return rng.choice(("orbits", "energies", "rdf", "msd", "vacf", "structure-factor", "integrators", "systems"))
    if name in ("integrator", "stability"):
        return rng.choice(NAMES)
    if name == "vary":
        return rng.choice(("dt=1:2:²", "dt=0.001:0.01:3", "dt=1e-3,2e-3", "seed=1,2", "integrator=rk4,leapfrog", "dt",
                           "=", "dt=", "x.y=1", "dt=log:0:1:3", "dt=1:2:99999999999", "dt=nan", "dt=normal:0:-1",
                           "particles.count=1:9:3", "dt=uniform:1:inf", "title=\x1b[31m", "dt=1:2:1e9"))  # fmt: skip
    if name == "measure":
        return rng.choice(
            ("run", "megno", "measure.py:f", "text.txt:f", "measure.py:none", ":", "measure.py:", "x.py:f")
        )
    if name == "workers":
        return rng.choice(("1", "1", "0", "-1", "1000000000", "1" + 18 * "0", "x"))
    if name == "scheduler":
        return rng.choice(("x", "", "tcp://", "tcp://127.0.0.1:1", "tcp://127.0.0.1:99999", "file:///etc/passwd"))
    if name == "names":
        return rng.choice(("no-such-script", "../x", "", "\x1b[31m", "-"))
    if name == "only":
        return rng.choice(("no-such-group", "", "\x1b[31m"))
    if name == "report":
        return rng.choice(("new.md", "folder", "text.txt", "no/such/x.md"))
    if "int" in kind:
        return rng.choice(("1", "2", "3", "5", "10", *NUMBERS))
    if "float" in kind:
        return rng.choice(("0.01", "0.1", "1", "1e-3", *NUMBERS))
    return rng.choice(("x", "float32", "forces", "images", "jacobi", "block", "10,4", *TEXTS, *NUMBERS))


def words(rng: random.Random, command: str) -> list[str]:
    """A command with its arguments and some of its options."""
    given: list[str] = []
    options = [each for each in commands()[command] if not is_argument(each)]
    for parameter in rng.sample(options, rng.randint(0, min(4, len(options)))):
        flag = rng.choice([*parameter.opts, *parameter.secondary_opts])
        if getattr(parameter, "is_flag", False):
            given.append(flag)
        else:
            given += [flag, value(rng, command, parameter)]
    for parameter in commands()[command]:
        if is_argument(parameter) and (parameter.required or rng.random() < 0.9):
            given.append(value(rng, command, parameter))
    return _short(rng, command, given)


def _short(rng: random.Random, command: str, given: list[str]) -> list[str]:
    """The same without work of minutes: what is right takes as long as it takes."""
    if command in ("run", "ensemble") and not {"--steps", "--time"} & {*given}:
        given += ["--steps", rng.choice(("0", "1", "2", "10"))]
    if command == "ensemble" and "--workers" not in given and "--scheduler" not in given:
        given += ["--workers", "1"]
    if command == "chaos" and "--time" not in given:
        given += ["--time", "1"]
    if command == "compare" and "--time" not in given:
        given += ["--time", "0.5"]
    if command == "bench lj-energy":
        given += ["--steps", "1", "--particles", rng.choice(("7", "0", "x", "1" + 12 * "0", "1" + 30 * "0", "9" * 30))]
    if command == "bench speed":
        given += ["--only", "no-such-group"]
    if command == "validate":
        given += ["no-such-script"]
    return given


def case(number: int, seed: int = 0) -> Case:
    rng = dice(KIND, seed, number)
    command = rng.choices(list(SHARES), list(SHARES.values()))[0]
    given = words(rng, command)
    about = [command]
    for _ in range(rng.choice((0, 0, 0, 0, 1, 2))):
        what = rng.choice(("lose", "double", "odd", "swap"))
        about.append(what)
        place = rng.randrange(len(given) + 1)
        if what == "lose" and command in ("run", "resume", "info", "export", "plot", "list") and place < len(given):
            if given[place] not in ("--steps", "--time"):
                del given[place]
        elif what == "double" and place < len(given):
            given.insert(place, given[place])
        elif what == "odd":
            given.insert(place, rng.choice((*TEXTS, "--no-such-option", "-h", "--help", "--", "--quiet=1", "-qqq")))
        elif what == "swap" and len(given) > 1:
            given[0], given[-1] = given[-1], given[0]
    if rng.random() < 0.04:
        about.append("load")
        given = ["--load", rng.choice(("measure.py", "text.txt", "missing.py", "folder", "loop", "pipe",
        "/dev/null", "")),
                 *command.split(), *given]  # fmt: skip
    else:
        given = [*command.split(), *given]
    given = [word.replace("\0", "") for word in given]
    changed: frozenset[str] = frozenset()
    if command == "resume" or "--overwrite" in given:
        changed = OURS & set(given)
    return Case(KIND, number, (tuple(given),), ", ".join(about), may_change=changed, may_compute=True, places=True)
