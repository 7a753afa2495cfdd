"""The commands certify, view, movie, ensemble and transits, with values that nobody wants and with damaged files."""

import random
from typing import Any

from kickdrift_validation.fuzzing import command_lines
from kickdrift_validation.fuzzing.case import NUMBERS, TEXTS, Case, dice
from kickdrift_validation.fuzzing.flips import flipped
from kickdrift_validation.fuzzing.places import WHOLE
from kickdrift_validation.fuzzing.run_files import NAME, OPERATIONS, base, damaged

KIND = "more-commands"
SHARES = {"view": 8, "movie": 5, "certify": 5, "ensemble": 3, "transits": 5}
# What is plausible, by the parameter's name.
GOOD: dict[str, tuple[str, ...]] = {
    "file": ("bodies.h5md", "liquid.h5md", "unfinished.h5md", "two-body", "lj.toml", "s.toml", "ode-harmonic"),
    "out": ("x.gif", "x.gif", "x.gif", "x.png", "x", "folder", "old.png", "/dev/null"),
    "files": ("bodies.h5md", "liquid.h5md", "lj.toml", "s.toml", "two-body"),
    "system": ("s.toml", "two-body", "lj.toml"),
    "planet": ("1", "2", "0", "3", "b", "Sun"),
    "until": ("3", "10", "'1 day'", "0", "-1"),
    "frames": ("1", "2", "10"),
    "colour": ("species", "speed", "body", "kinetic energy", "tomato", "#0072B2", "#xyz"),
    "size": ("64x48", "64x48", "1", "0.5", "0x0", "64", "64x", "99999x99999"),
    "fps": ("5", "1", "1000"),
    "duration": ("0.2", "1"),
    "direction": ("0,0,1", "1,0,0", "0,0,0", "1,2", "a,b,c", "nan,0,1"),
    "elements": ("1.e", "1.a", "2.", ".e", "1.x", "99.e"),
    "star": ("0", "1", "x"),
    "temperature": ("1", "0.7", "0"),
    "pressure": ("1", "0"),
    "calculator": ("ase.calculators.emt.EMT", "os.system", "x", "."),
    "topology": ("text.txt", "missing.psf", "folder"),
}
CHEAP = {"movie": ["--size", "64x48"], "certify": ["--every", "5"]}


def value(rng: random.Random, command: str, parameter: Any) -> str:
    """Something to give for a parameter: most of the time a plausible value."""
    if parameter.name in GOOD and rng.random() < 0.8:
        return rng.choice(GOOD[parameter.name])
    if rng.random() < 0.3:
        return rng.choice((*TEXTS, *NUMBERS, *command_lines.OTHERS))
    return command_lines.value(rng, command, parameter)


def words(rng: random.Random, command: str) -> list[str]:
    """A command with its arguments and some of its options."""
    parameters = command_lines.commands()[command]
    options = [each for each in parameters if not command_lines.is_argument(each)]
    given: list[str] = []
    for parameter in rng.sample(options, rng.randint(0, min(4, len(options)))):
        flag = rng.choice([*parameter.opts, *parameter.secondary_opts])
        given += [flag] if getattr(parameter, "is_flag", False) else [flag, value(rng, command, parameter)]
    if command == "ensemble":
        return command_lines.words(rng, command)
    if command == "transits" and "--until" not in given:
        given += ["--until", rng.choice(GOOD["until"])]
    if command in CHEAP and CHEAP[command][0] not in given:
        given += CHEAP[command]
    for parameter in parameters:
        if command_lines.is_argument(parameter) and (parameter.required or rng.random() < 0.9):
            given += [value(rng, command, parameter) for _ in range(1 if parameter.nargs == 1 else rng.randint(1, 2))]
    return given


def case(number: int, seed: int = 0) -> Case:
    """The case of that number: odd words for two of three, else a damaged file of a run."""
    rng = dice(KIND, seed, number)
    command = rng.choices(list(SHARES), list(SHARES.values()))[0]
    if rng.random() < 2 / 3 or command in ("ensemble", "transits"):
        given = [word.replace("\0", "") for word in (command, *words(rng, command))]
        given = [word for word in given if word != "--open"]  # a browser is not ours to start
        changed = command_lines.OURS & set(given) if "--overwrite" in given else frozenset[str]()
        return Case(KIND, number, (tuple(given),), command, may_change=changed, may_compute=True, places=True)
    name = rng.choice(list(WHOLE))
    if rng.random() < 0.5:
        data, what = flipped(rng, base(f"{name}.h5md"), name)
    else:
        operations = rng.choices(list(OPERATIONS), list(OPERATIONS.values()), k=rng.choice((1, 1, 2)))
        data, about = damaged(rng, base(f"{name}.h5md"), operations)
        what = "; ".join(about)
    ways = {
        "view": ("view", NAME, "--no-open", "--output", "x.html"),
        "movie": ("movie", NAME, "x.gif", "--size", "64x48", "--every", "4"),
        "certify": ("certify", NAME),
    }
    return Case(KIND, number, (ways[command],), f"{command} of {name}: {what}", {NAME: data}, may_compute=True)
