"""A run's file as people see it: its content in lines, and its figures."""

from __future__ import annotations

from typing import Any

from kickdrift.disk.outputs import plain
from kickdrift.display.card import Spark
from kickdrift.display.showing import Lines, Shown, above
from kickdrift.looks.report_lines import energy_spark


class ShownRun(Shown):
    """An open run's file that prints what ``kickdrift info`` prints, and draws what ``kickdrift plot`` draws."""

    def _lines(self) -> Lines:
        return above("run lines")(self)

    def _spark(self: Any) -> Spark | None:
        seen = self.whole_samples().observables
        if not {"total_energy", "kinetic_energy"} <= seen.keys() or not len(seen["kinetic_energy"]):
            return None
        return energy_spark(seen["total_energy"] + seen.get("energy_taken", 0.0), seen["kinetic_energy"][0])

    def as_json(self) -> dict[str, Any]:
        """Content of the file in numbers and texts, as ``kickdrift info --json`` writes it."""
        return plain(above("run content")(self))

    def view(
        self, *, frames: int | None = None, colour: str | None = None, size: float = 1.0, height: int | None = None
    ) -> Any:
        """Show the frames in a picture that turns: a widget in a notebook, else an object with ``save(path)``.

        ``height`` is in pixels; ``colour`` and ``size`` are those of `kickdrift view`.
        ``frames`` is the most of them. See docs/live.md."""
        return above("view")(self, frames=frames, colour=colour, size=size, height=height)

    def plot(self, kind: str | None = None, *, column: str | None = None) -> Any:
        """Draw the run; a matplotlib Figure.

        Parameters
        ----------
        kind : "orbits", "energies", "rdf", "msd", "vacf" or "structure-factor"; default orbits under gravity, else
            energies with their error, the temperature and g(r)
        column : a column of the samples, drawn against time instead

        Raises
        ------
        InputError
            For an unknown name, and a run without what the figure shows.
        """
        return above("run figure")(self, kind, column)


class ShownProblemRun(Shown):
    """The run of a Problem, open, that prints what ``kickdrift info`` prints, and draws what ``kickdrift plot``
    draws."""

    def _lines(self) -> Lines:
        return above("problem lines")(self)

    def _spark(self: Any) -> Spark | None:
        y, energies = self.y, self.energies
        if energies is not None:
            return energy_spark(energies, 0.0)
        return Spark(y[:, 0].tolist(), "y0") if len(y) > 1 else None

    def plot(self, *, column: str | None = None) -> Any:
        """Draw y against time, the phase portrait and the energy error, or one ``column``; a matplotlib Figure.

        Raises InputError for an unknown column, and for a run without samples."""
        return above("problem figure")(self, column)
