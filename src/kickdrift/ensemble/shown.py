"""An ensemble's table as a notebook shows it."""

from collections.abc import Callable

import pandas as pd

from kickdrift.display.card import Spark, card
from kickdrift.ensemble.rows import DONE, MEMBER
from kickdrift.text import counted

ERROR = "energy_rms_relative_error"


class Table(pd.DataFrame):
    """A DataFrame that a notebook shows in a card, with the energy error of each member as a sparkline."""

    @property
    def _constructor(self) -> Callable[..., pd.DataFrame]:
        return pd.DataFrame  # parts of the table are plain

    def _repr_html_(self) -> str | None:
        found = super()._repr_html_()
        if found is None or not {MEMBER, "status"} <= set(self.columns):
            return found
        done = int((self["status"] == DONE).sum())
        caption = f"{done:,} of {counted(len(self), 'member', ',')} done"
        values = self[ERROR].to_numpy(dtype=float).tolist() if ERROR in self.columns else []
        return card(found, Spark(values, f"{caption}; RMS energy error by member" if values else caption))
