"""Hosts files with odd lines, and what is no file: a run is set up for them, and nothing is started."""

import random

from kickdrift_validation.fuzzing.case import NUMBERS, TEXTS, Case, dice
from kickdrift_validation.fuzzing.system_files import cut, letters, line

KIND = "hosts"
NAME = "hosts"
PLACES = ("pipe", "loop", "folder", "/dev/null", "/dev/zero", "empty", "missing", "/proc/self/mem", "bodies.h5md", "",
          "link.toml", "n" * 300, "bad\udcff")  # fmt: skip
LINES = ("localhost", "localhost:2", "127.0.0.1:3", "node1:16", "node2:4  # the other", "# nothing", "", "localhost:0")
COUNTS = ("1", "2", "1023", "1024", "1025", "999999", "99999999999")


def text(rng: random.Random) -> str:
    """Some lines, most of them right."""
    found = []
    for _ in range(rng.choice((1, 2, 3, 10))):
        odd = (f"localhost:{rng.choice((*COUNTS, *NUMBERS))}", rng.choice(TEXTS), f"{rng.choice(TEXTS)}:2")
        found.append(rng.choice(LINES) if rng.random() < 0.7 else rng.choice(odd))
    whole = "\n".join(found) + "\n"
    for _ in range(rng.choice((0, 0, 1, 2))):
        whole = rng.choice((letters, line, cut))(rng, whole)
    return whole * rng.choice((1, 1, 1, 1, 500, 100_000))


def case(number: int, seed: int = 0) -> Case:
    rng = dice(KIND, seed, number)
    own = rng.random() < 0.85
    name, files = NAME, {NAME: text(rng).encode("utf-8", "surrogatepass")} if own else {}
    if not own:
        name = rng.choice(PLACES)
    processes = rng.choice(("", "", "1", "2", "1000", "5000", "1000000000"))
    way = ("!set_up", name, processes)
    if rng.random() < 0.2:  # the whole command, which refuses hosts after it has read them
        way = ("run", "lj.toml", "--hosts", name, "--steps", "1", "--quiet")
    return Case(KIND, number, (way,), f"hosts {name[:20]!a}, {processes or 'all'}", files, places=True)
