"""Programs that keep memory between calls, such as a list of neighbours: they begin anew at known places.

So the results of a run do not depend on what was asked before, and a run that is resumed has the same bits.
"""

from __future__ import annotations

import weakref
from typing import Any

from kickdrift.forces.external.kernel import Host

_BEGUN: weakref.WeakKeyDictionary[Any, Begun] = weakref.WeakKeyDictionary()  # by program


class Begun:
    """Where a program last began anew: at the reference of a host, or at a sample of that host."""

    host: weakref.ref[RenewedHost] | None = None
    at_sample = False

    def by(self, host: RenewedHost, at_sample: bool) -> bool:
        """Whether this host made it begin, there."""
        return self.host is not None and self.host() is host and self.at_sample == at_sample

    def note(self, host: RenewedHost | None, at_sample: bool = False) -> None:
        """Note where the program has begun; None for nowhere that is known."""
        self.host, self.at_sample = None if host is None else weakref.ref(host), at_sample


class RenewedHost(Host):
    """A host whose ``program`` begins anew at places that the positions alone determine."""

    def __init__(self, program: Any, *given: Any, **more: Any) -> None:
        super().__init__(*given, **more)
        self._begun = _BEGUN.setdefault(program, Begun())

    def answer(self, time: float, aside: bool) -> None:
        """See Host. A far place makes the program begin anew, there; a near one does so at the reference if another
        user of the program has moved it. Another box is far from any place."""
        self.follow_box()
        begun = self._begun
        if self.follows_sample:
            self.begin_here()
            begun.note(self if begun.by(self, at_sample=True) else None)
            return
        if self.far:
            if not aside:
                self.begin_here()
            begun.note(None)
            self.calculate(anew=True)
            begun.note(self, at_sample=aside)
            return
        if not begun.by(self, at_sample=False):
            begun.note(None)
            here = self.parts.positions.copy()
            try:
                self.parts.positions[...] = self.parts.reference
                self.calculate(anew=True)
            finally:
                self.parts.positions[...] = here
            begun.note(self)
        self.calculate(anew=False)

    def follow_box(self) -> None:
        """Give the program the box of now."""
        raise NotImplementedError

    def calculate(self, anew: bool) -> None:
        """Let the program begin anew or go on, at the present positions, and store what it finds."""
        raise NotImplementedError
