"""What the members of an ensemble say together: means over replicas with their standard errors."""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from kickdrift.ensemble.rows import DONE, LAST, MEMBER
from kickdrift.ensemble.table import PROVENANCE
from kickdrift.errors import InputError
from kickdrift.model.units import shown, suggestion

if TYPE_CHECKING:
    from pandas import DataFrame

_NOT_MEASURED = (MEMBER, "replica", "seed", "dt", "steps", "time", "force_evaluations", *LAST)
LAST_OF_RUN = "warnings"  # the column that a user's function's follow
_FIRST = ("megno", "pressure", "energy_max_relative_error")  # what is shown of an ensemble unless told


def grids(table: DataFrame) -> list[str]:
    """The keys that took several values on a grid."""
    return [key for key, values in table.attrs[PROVENANCE]["grids"].items() if len(values) > 1]


def drawn(table: DataFrame) -> list[str]:
    """The keys whose values were drawn."""
    return list(table.attrs[PROVENANCE]["draws"])


def measured(table: DataFrame) -> list[str]:
    """The columns of numbers that were measured, of which there are any."""
    given = {*_NOT_MEASURED, *table.attrs[PROVENANCE]["grids"], *drawn(table)}
    numbers = [name for name in table.columns if name not in given and table[name].dtype.kind in "if"]
    return [name for name in numbers if np.isfinite(table[name]).any()]


def chosen(table: DataFrame, column: str | None = None) -> str:
    """The column asked for, or the one that tells most: what a user's function measured, else the first of _FIRST."""
    known = measured(table)
    if column is not None:
        if column not in known:
            raise InputError(
                f"column: expected one of {', '.join(known)}, got {shown(column)}{suggestion(column, known)}"
            )
        return column
    if not known:
        raise InputError("no member has a measured number")
    columns = list(table.columns)
    own = columns[columns.index(LAST_OF_RUN) + 1 :] if LAST_OF_RUN in columns else []
    return next((name for name in (*own, *_FIRST) if name in known), known[0])


def by_point(table: DataFrame, column: str) -> DataFrame:
    """For each combination of values on the grids: the ``mean`` of a column over its members that are done, its
    standard ``error`` (the standard deviation over the root of their number; NaN for one), and the ``members``. The
    index is the combination's number, in which the last grid's values change fastest; one with no member is left out.
    """
    import pandas as pd

    done = table[table["status"] == DONE]
    values = list(product(*table.attrs[PROVENANCE]["grids"].values()))
    keys, varied = list(table.attrs[PROVENANCE]["grids"]), grids(table)
    groups = done.groupby(done[MEMBER] % len(values))
    rows = {
        point: {key: value for key, value in zip(keys, values[point], strict=True) if key in varied}
        | moments(group[column])
        for point, group in groups
    }
    return pd.DataFrame(list(rows.values()), index=list(rows))


def moments(values: Any) -> dict[str, float]:
    """Of one column's finite values: see `by_point`."""
    known = values.to_numpy(dtype=float)
    known = known[np.isfinite(known)]
    count = len(known)
    mean = float(known.mean()) if count else np.nan
    error = float(known.std(ddof=1) / np.sqrt(count)) if count > 1 else np.nan
    return {"mean": mean, "error": error, "members": count}
