"""A case: commands, the files that they find, and what they may change."""

import random
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TypeVar

T = TypeVar("T")
ALL_STATUSES = (0, 1, 2)


@dataclass(frozen=True)
class Case:
    """Commands that run one after the other in a folder of their own.

    Attributes
    ----------
    commands : tuple of tuples
        Arguments of ``kickdrift``, each a command. A command whose first word begins with "!" is a function of the
        module `actions`.
    about : str
        The mutation, in words.
    files : dict
        Names and bytes of files that the case finds.
    may_change : set of str
        Names of existing files that the commands may write to.
    statuses : tuple of int
        Exit statuses that are right.
    may_compute : bool
        Whether a long run is a right answer. Such a run is interrupted, as by Ctrl-C.
    places : bool
        Whether the case finds the usual inputs too, and pipes, loops and folders: see `places`.
    kill_after : float, optional
        Seconds after which the first command is killed.
    """

    kind: str
    number: int
    commands: tuple[tuple[str, ...], ...]
    about: str
    files: dict[str, bytes] = field(default_factory=dict)
    may_change: frozenset[str] = frozenset()
    statuses: tuple[int, ...] = ALL_STATUSES
    may_compute: bool = False
    places: bool = False
    kill_after: float | None = None


def dice(kind: str, seed: int, number: int) -> random.Random:
    return random.Random(f"{kind}/{seed}/{number}")


NUMBERS = (
    "0", "-1", "-0.0", "1", "2", "0.1", "1e-300", "5e-324", "1e308", "-1e308", "1e400", "nan", "inf", "-inf",
    "1e15", "1000000000000", "9223372036854775807", "9223372036854775808", "-9223372036854775809",
    "18446744073709551616", "1" + 30 * "0", "1" + 5000 * "0", "0x10", "1_000", "007", "1.", ".5", "1e", "--1", "²", "٣",
)  # fmt: skip
TEXTS = (
    "", " ", "\t", "x", "\x1b[31mred\x1b[0m", "\x1b]0;title\x07", "\x7f\x9b31m", "a" * 10_000, "é" * 3000, "\u202egnp",
    "\u2028", "😀", "../../etc/passwd", "/etc/passwd", "__import__('os').system('touch called')", "{0.__class__}",
    "%s%n%d", "a\nb", "a\rb", "-", "--", "=", ":", "None", "true", "[]", "{}", "lj", "H2O", "\ufeff", "CON", "a.b.c",
)  # fmt: skip
FOREIGN_UNITS = ("mol", "K/mol", "cd", "percent", "bit", "count", "lumen", "K*s*A")  # no quantity has these
UNITS = (
    "", "u", "uuuu" * 12 + "!", "u u u u u u u u u u u u u u u u u u u u u u u u !", "m" * 5000, "m^99999", "m**-1e9",
    "1/0", "m/0", "(((((m", "m" + "/s" * 2000, "\x1b[2Jm", "µm", "Å", "Ångström", "K", "degC", "dB", "m\n", "angstrom",
    "__class__", "kg*kg*kg*kg", "m^^2", "m**m", "nm nm", "1 2", "𝟏 m", "m^(1/3)", "light_year", "eV^0",
)  # fmt: skip


def some(rng: random.Random, things: Sequence[T], most: int) -> list[T]:
    """Up to ``most`` different ones, at least one."""
    return rng.sample(things, min(len(things), rng.randint(1, most)))
