"""System files that are broken: every file that ships, made small, with one to four mutations of its text."""

import random
import re
from collections.abc import Callable
from functools import cache

from kickdrift_validation.fuzzing.case import FOREIGN_UNITS, NUMBERS, TEXTS, UNITS, Case, dice

KIND = "system-files"
NUMBER = re.compile(r"(?<![\w.\"])[-+]?\d[\d_]*(?:\.\d*)?(?:[eE][-+]?\d+)?(?![\w.])")
STRING = re.compile(r'"[^"\n]*"')
KEY = re.compile(r"^(\s*)([\w.-]+)(\s*=)", re.MULTILINE)
QUANTITY = re.compile(r'"([-+]?[\d.]+(?:e[-+]?\d+)?) [^"\n]+"')
HEADER = re.compile(r"^\[+[\w.]+\]+", re.MULTILINE)
PARTICLES = 216  # at most, of a lattice: the smallest box that holds a cutoff of 2.5
Mutation = Callable[[random.Random, str], str]


@cache
def bases() -> dict[str, str]:
    """Texts of the systems that ship, with fewer particles and without the time that equilibration takes."""
    from kickdrift.systemfile.files import shipped

    found = {}
    for name, path in sorted(shipped().items()):
        text = re.sub(r"^#.*\n", "", path.read_text(encoding="utf-8"), flags=re.MULTILINE)
        text = re.sub(r"\bcount = (864|1000)", f"count = {PARTICLES}", text)
        if name == "argon-864":
            text = text.replace("34.78", "22.0")
        found[name] = text
    return found


def replaced(rng: random.Random, text: str, pattern: re.Pattern[str], by: Callable[[re.Match[str]], str]) -> str:
    """The text with one match, drawn, replaced."""
    matches = list(pattern.finditer(text))
    if not matches:
        return text
    match = rng.choice(matches)
    return text[: match.start()] + by(match) + text[match.end() :]


def quoted(text: str) -> str:
    """A string of TOML in which nothing is escaped."""
    return '"' + text + '"'


def escaped(text: str) -> str:
    """A string of TOML with every character as an escape."""
    return '"' + "".join(f"\\U{ord(letter):08x}" for letter in text) + '"'


def number(rng: random.Random, text: str) -> str:
    return replaced(rng, text, NUMBER, lambda match: rng.choice(NUMBERS))


def number_as_other(rng: random.Random, text: str) -> str:
    others = (quoted(rng.choice(TEXTS)), "true", "[]", "{}", "[[1.0]]", "1979-05-27T07:32:00Z", "{ a = 1 }", '[1, "a"]')
    return replaced(rng, text, NUMBER, lambda match: rng.choice(others))


def string(rng: random.Random, text: str) -> str:
    write = rng.choice((quoted, escaped))
    return replaced(rng, text, STRING, lambda match: write(rng.choice(TEXTS)))


def unit(rng: random.Random, text: str) -> str:
    pattern = rng.choice((QUANTITY, NUMBER))
    return replaced(
        rng, text, pattern,
        lambda match: quoted(f"{match[1] if match.re is QUANTITY else match[0]} {rng.choice(UNITS)}"),
    )  # fmt: skip


def key(rng: random.Random, text: str) -> str:
    names = [match[2] for match in KEY.finditer(text)]

    def other(match: re.Match[str]) -> str:
        return match[1] + rng.choice([escaped(rng.choice(TEXTS)), match[2] + "x", rng.choice(names)]) + match[3]

    return replaced(rng, text, KEY, other)


def header(rng: random.Random, text: str) -> str:
    others = ("[x]", "[[force]]", "[particles.x]", "[[run]]", "[force]", "[" + "a." * 300 + "b]", "[]", "[[particles]]")
    return replaced(rng, text, HEADER, lambda match: rng.choice((*others, f"{match[0]}\n{match[0]}")))


def line(rng: random.Random, text: str) -> str:
    """One line lost, doubled, or in another's place."""
    lines = text.splitlines()
    if len(lines) < 2:
        return text
    a, b = rng.randrange(len(lines)), rng.randrange(len(lines))
    what = rng.randrange(3)
    if what == 0:
        del lines[a]
    elif what == 1:
        lines.insert(b, lines[a])
    else:
        lines[a], lines[b] = lines[b], lines[a]
    return "\n".join(lines) + "\n"


def nesting(rng: random.Random, text: str) -> str:
    depth = rng.choice((1, 2, 5, 100, 900, 20_000))
    left, right = rng.choice((("[", "]"), ("{ a = ", " }")))
    return replaced(rng, text, rng.choice((NUMBER, STRING)), lambda match: left * depth + match[0] + right * depth)


def size(rng: random.Random, text: str) -> str:
    """A number or string that becomes a long list of itself."""
    times = rng.choice((2, 3, 100, 20_000))
    return replaced(rng, text, rng.choice((NUMBER, STRING)), lambda match: "[" + ", ".join([match[0]] * times) + "]")


def letters(rng: random.Random, text: str) -> str:
    """A few characters put in or lost."""
    for _ in range(rng.randint(1, 5)):
        place = rng.randrange(len(text) + 1)
        insert = rng.choice(
            ('"', "[", "]", "{", "}", "=", "#", ",", ".", "\\", "\0", "\x1b", "é", "\n", "", "'''", "😀")
        )
        text = text[:place] + insert + text[place + rng.randrange(3) :]
    return text


def cut(rng: random.Random, text: str) -> str:
    return text[: rng.randrange(len(text) + 1)]


def extra(rng: random.Random, text: str) -> str:
    """A table or key from another file, or one of which nobody has heard."""
    other = rng.choice(list(bases().values()))
    blocks = [block for block in re.split(r"\n(?=\[)", other) if block.startswith("[")]
    name = escaped(rng.choice(TEXTS))
    more = (f"[{name}]\nx = 1\n", f"{name} = 1\n", f"[species.{name}]\nmass = 1.0\n", *blocks[:1])
    return text + "\n" + rng.choice((*more, rng.choice(blocks)))


MUTATIONS: dict[Mutation, int] = {
    number: 6, number_as_other: 3, string: 4, unit: 4, key: 3, header: 2, line: 3, nesting: 2, size: 2, letters: 3,
    cut: 1, extra: 3,
}  # fmt: skip


def foreign_unit(rng: random.Random, text: str) -> str:
    """A quantity with a dimension that no quantity of a system file has."""
    name = rng.choice(FOREIGN_UNITS)
    return replaced(rng, text, QUANTITY, lambda match: quoted(f"{match[1]} {name}"))


def case(number: int, seed: int = 0) -> Case:
    rng = dice(KIND, seed, number)
    name = rng.choice(list(bases()))
    text, statuses, about = bases()[name], (0, 1, 2), [name]
    if rng.random() < 0.05 and QUANTITY.search(text):
        text, statuses = foreign_unit(rng, text), (2,)
        about.append("foreign_unit")
    else:
        for mutate in rng.choices(list(MUTATIONS), list(MUTATIONS.values()), k=rng.choice((1, 1, 1, 2, 3, 4))):
            text = mutate(rng, text)
            about.append(mutate.__name__)
    data = text.encode("utf-8", "surrogatepass")
    if rng.random() < 0.03:
        place = rng.randrange(len(data) + 1)
        data = data[:place] + rng.randbytes(rng.randint(1, 4)) + data[place:]
        about.append("bytes")
    # Equilibration may rightly take long, so that `info` alone looks at a file that asks for one.
    info = b"equilibrate" in data or rng.random() < 0.3
    command = ("info", "s.toml") if info else ("run", "s.toml", "--steps", "2", "--quiet")
    if command[0] == "run" and re.search(rb"^rtol", data, re.MULTILINE):
        command = ("run", "s.toml", "--quiet")
    return Case(KIND, number, (command,), ", ".join(about), {"s.toml": data}, statuses=statuses, may_compute=True)
