"""Writing the file of a Problem's run: the writer of every run's file, without frames."""

import os
import uuid
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

from numpy.typing import ArrayLike

from kickdrift.disk import kinds
from kickdrift.model.problem import Problem, ProblemState
from kickdrift.trajectory.file.openfile import create, opening
from kickdrift.trajectory.layout import problem_header as header
from kickdrift.trajectory.layout.checkpoints import Checkpoint
from kickdrift.trajectory.layout.options import FileOptions
from kickdrift.trajectory.layout.problem_header import ENERGY, Y
from kickdrift.trajectory.problems.reader import ProblemRun
from kickdrift.trajectory.problems.record import problem_image, record_of
from kickdrift.trajectory.read.recorded import Recorded
from kickdrift.trajectory.write.continued import Cadence, Described, units_of
from kickdrift.trajectory.write.h5md import FLUSH_BYTES, Writer


class ProblemWriter(Writer):
    """Writes one run of a Problem; a context manager. See `Writer`; there are samples of y, and no frames.

    Parameters
    ----------
    path : a new file with the suffix .h5, in a folder that exists
    problem : Problem
    method, every, overwrite, options, checkpoint, plan, columns : as for `Writer`
    slopes : f at the states of ``problems.record.states_to_compare``, which tell this f from another
    events : names of the events that the run watches for
    """

    units: ClassVar[dict[str, str]] = {Y: "", ENERGY: ""}

    def __init__(
        self,
        path: str | os.PathLike[str],
        problem: Problem,
        *,
        method: Mapping[str, Any],
        every: int,
        slopes: Sequence[Any] = (),
        events: Sequence[str] = (),
        overwrite: bool = False,
        options: FileOptions | None = None,
        flush_bytes: int = FLUSH_BYTES,
        checkpoint: Callable[[], Checkpoint] | None = None,
        plan: Sequence[float] = (),
        columns: Mapping[str, Described] | None = None,
    ) -> None:
        flush, run_id = (options or FileOptions()).flush, uuid.uuid4().hex
        image = problem_image(
            problem,
            record_of(problem, slopes, events),
            method=dict(method),
            every=every,
            run_id=run_id,
            plan=plan,
            start=Cadence(checkpoint).take(),
        )
        with opening:
            own = create(Path(path), image, overwrite=overwrite, kind=kinds.PROBLEM)
            self._open(Path(path), flush_bytes, flush, checkpoint, run_id, made=(own, header.outline()))
        self._rows.columns = self.units | units_of(columns)

    @staticmethod
    def _reading(path: Path) -> Recorded:
        return ProblemRun(path)

    def _kept(self) -> str:
        last = self._rows.last_sample
        return "holds no sample yet" if last is None else f"holds {self._rows.samples} samples, up to step {last[0]}"

    def append_look(self, state: ProblemState, values: Mapping[str, ArrayLike], energy: float | None) -> None:
        """Add a sample: y, the energy if the Problem has one, and the ``values`` of the user's columns."""
        own: dict[str, ArrayLike] = {Y: state.y}
        if energy is not None:
            own[ENERGY] = energy
        self.append(state, own | dict(values), frame=False)  # type: ignore[arg-type]
