"""Runs that advance in turns, so that forces which Python computes are asked for all of them in one call.

Each run has a thread. Only one thread works at a time: until its run asks for forces, or ends. When all runs wait, the
thread that began them evaluates all questions together, always in the order of the runs. So nothing depends on chance,
and a program such as a neural network is called from one thread alone.
"""

import threading
from collections.abc import Callable, Hashable, Sequence
from typing import Any, NamedTuple, TypeVar

from kickdrift.errors import InputError

Answers = Callable[[list[Any]], Sequence[Any]]  # an answer for each item
Result = TypeVar("Result")
_here = threading.local()  # the seat of the run in this thread


class Question(NamedTuple):
    """A question that a run asks. Questions with the same ``key`` are answered together."""

    key: Hashable
    answers: Answers
    item: Any


class _Seat:
    """A run's place among the others."""

    def __init__(self, work: Callable[[], Any], back: threading.Semaphore) -> None:
        self._work, self._back = work, back
        self._turn = threading.Semaphore(0)
        self.question: Question | None = None
        self.answer: Any = None
        self.error: BaseException | None = None  # of the last question, then of the work
        self.result: Any = None
        self.over = self._left = False
        self._thread = threading.Thread(target=self._run, daemon=True)

    def _run(self) -> None:
        _here.seat = self
        self._turn.acquire()
        try:
            if not self._left:
                self.result = self._work()
        except BaseException as error:
            self.error = error
        self.over = True
        self._back.release()

    def begin(self) -> None:
        """Start the thread, which waits for its turn."""
        self._thread.start()

    def go_on(self) -> None:
        """Let the run work until its next question or its end."""
        self.question = None
        self._turn.release()
        self._back.acquire()

    def leave(self) -> None:
        """End a run whose questions nobody answers any more."""
        self._left = True
        while self._thread.ident is not None and not self.over:
            self.go_on()

    def ask(self, question: Question) -> Any:
        """Wait for the answer; called in the run's own thread."""
        self.question, self.answer, self.error = question, None, None
        self._back.release()
        self._turn.acquire()
        if self._left:
            raise InputError("the runs beside this one have stopped")
        if (error := self.error) is not None:
            self.error = None
            raise error
        return self.answer


def asked(question: Question) -> Any:
    """The answer to a question: together with those of the other runs if this run has others beside it, else alone."""
    seat: _Seat | None = getattr(_here, "seat", None)
    return seat.ask(question) if seat else _answered([question])[0]


def in_turns(works: Sequence[Callable[[], Result]]) -> list[Result]:
    """Call functions that run simulations, in turns, and return what they return.

    Raises the first exception that one of them raised, after all have ended."""
    back = threading.Semaphore(0)
    seats = [_Seat(work, back) for work in works]
    try:
        for seat in seats:
            seat.begin()
            seat.go_on()
        while waiting := [seat for seat in seats if not seat.over]:
            _answer(waiting)
            for seat in waiting:
                seat.go_on()
    finally:
        for seat in seats:
            seat.leave()
    for seat in seats:
        if seat.error is not None:
            raise seat.error
    return [seat.result for seat in seats]


def _answer(seats: Sequence[_Seat]) -> None:
    """Answer the questions of all seats, those with one key together. If that fails, each is answered alone, so that
    only the culprit's run fails."""
    groups: dict[Hashable, list[tuple[_Seat, Question]]] = {}
    for seat in seats:
        assert seat.question is not None
        groups.setdefault(seat.question.key, []).append((seat, seat.question))
    for group in groups.values():
        try:
            answers = _answered([question for _, question in group])
        except Exception as error:
            if len(group) == 1:
                group[0][0].error = error
            else:
                for seat, _ in group:
                    _answer([seat])
            continue
        for (seat, _), answer in zip(group, answers, strict=True):
            seat.answer = answer


def _answered(questions: Sequence[Question]) -> Sequence[Any]:
    return questions[0].answers([question.item for question in questions])
