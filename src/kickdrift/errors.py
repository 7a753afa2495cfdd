"""The two ways in which a user's run can end badly; the command line turns each into one line and an exit status."""

from __future__ import annotations

from typing import Any

from kickdrift.text import clean


class KickdriftError(Exception):
    """Base of every error that kickdrift raises on purpose.

    The message is one line without control characters, whatever it quotes.
    """

    exit_status = 1

    def __init__(self, *args: Any) -> None:
        super().__init__(*(clean(each) if isinstance(each, str) else each for each in args))


class InputError(KickdriftError, ValueError):
    """What the user gave cannot be run; the message names the key, particle or pair and what was expected (exit 2)."""

    exit_status = 2


class RunError(KickdriftError, RuntimeError):
    """A run failed on the way; the message names the step and the cause (exit 1).

    ``state`` is the last good one, of a run that blew up: a State or a ProblemState.
    """

    exit_status = 1
    state: Any = None
