"""The two kinds of error in a user's run; the command line turns each into one line and an exit status."""

from __future__ import annotations

from typing import Any

from kickdrift.text import clean


class KickdriftError(Exception):
    """Base of every error that kickdrift raises on purpose. The message is one line without control characters, even if
    it quotes the user's text."""

    exit_status = 1

    def __init__(self, *args: Any) -> None:
        super().__init__(*(clean(each) if isinstance(each, str) else each for each in args))


class InputError(KickdriftError, ValueError):
    """Input that cannot be run. The message names the key, particle or pair and the expected value (exit status 2)."""

    exit_status = 2


class RunError(KickdriftError, RuntimeError):
    """Failure of a run. The message names the step and the cause (exit status 1).

    For a run that blew up, ``state`` is the last good State or ProblemState, and ``failed_at`` the step that failed and
    its time.
    """

    exit_status = 1
    state: Any = None
    failed_at: tuple[int, float] | None = None
