"""Summary of an ensemble's members: means over replicas with their standard errors."""

from itertools import product
from typing import Any

import numpy as np

from kickdrift.ensemble.rows import DONE, ERRORS, LAST, MEMBER, THERMAL, DataFrame, mean_of
from kickdrift.ensemble.table import PROVENANCE
from kickdrift.errors import InputError
from kickdrift.text import choices, shown, suggestion

_NOT_MEASURED = (MEMBER, "replica", "seed", "dt", "steps", "time", "force_evaluations", *LAST)
LAST_OF_RUN = "warnings"  # the columns of a user's function follow this one
_FIRST = ("megno", "time", "pressure", "energy_max_relative_error")  # columns shown by default


def grids(table: DataFrame) -> list[str]:
    """Keys with several values on a grid."""
    return [key for key, values in table.attrs[PROVENANCE]["grids"].items() if len(values) > 1]


def drawn(table: DataFrame) -> list[str]:
    """Keys with random values."""
    return list(table.attrs[PROVENANCE]["draws"])


def measured(table: DataFrame) -> list[str]:
    """Measured columns of numbers that have any; the time too, where events stopped members."""
    stops = "stopped" in table and bool((table["stopped"] != "").any())
    given = {
        *(name for name in _NOT_MEASURED if not (stops and name == "time")),
        *table.attrs[PROVENANCE]["grids"],
        *drawn(table),
    }
    given |= {error for name, error in ERRORS.items() if name in table and error not in _own(table)}
    numbers = [name for name in table.columns if name not in given and table[name].dtype.kind in "if"]
    return [name for name in numbers if np.isfinite(table[name]).any()]


def chosen(table: DataFrame, column: str | None = None) -> str:
    """The requested column, or the most informative one: a user's measured column, else the first of _FIRST."""
    known = measured(table)
    if column is not None:
        if column not in known:
            raise InputError(
                f"column: expected one of {choices(known, column)}, got {shown(column)}{suggestion(column, known)}"
            )
        return column
    if not known:
        raise InputError("no member has a measured number")
    return next((name for name in (*_own(table), *_FIRST) if name in known), known[0])


def _own(table: DataFrame) -> list[str]:
    """Columns of a user's function."""
    columns = list(table.columns)
    return columns[columns.index(LAST_OF_RUN) + 1 :] if LAST_OF_RUN in columns else []


def scanned(table: DataFrame) -> list[str]:
    """Columns for the points of a scan: the most informative one, and the thermal ones, if there are any."""
    first, known = chosen(table), measured(table)
    thermal = [mean_of(name, table.attrs[PROVENANCE]["grids"]) for name in THERMAL]
    found = [name for name in thermal if name in known] if "energy" in thermal and ERRORS["energy"] in table else []
    return found if first in found else [first, *found]


def by_point(table: DataFrame, column: str) -> DataFrame:
    """Mean of a column for each combination of the grids' values.

    ``mean`` is over the members that are done. ``error`` is the standard error, the standard deviation over the root of
    the number of ``members``. For one member it is the error that its run states, NaN if there is none. The index is
    the combination's number, in which the last grid's values change fastest; combinations without members are left out.
    """
    import pandas as pd

    done = table[table["status"] == DONE]
    values = list(product(*table.attrs[PROVENANCE]["grids"].values()))
    keys, varied = list(table.attrs[PROVENANCE]["grids"]), grids(table)
    groups = done.groupby(done[MEMBER] % len(values))
    rows = {
        point: {key: value for key, value in zip(keys, values[point], strict=True) if key in varied}
        | _with_own_error(group, column)
        for point, group in groups
    }
    return pd.DataFrame(list(rows.values()), index=list(rows))


def _with_own_error(group: DataFrame, column: str) -> dict[str, float]:
    found, own = moments(group[column]), ERRORS.get(column.removeprefix("mean_"))
    return found | {"error": float(group[own].iloc[0])} if len(group) == 1 and own in group else found


def moments(values: Any) -> dict[str, float]:
    """Moments of a column's finite values: see `by_point`."""
    known = values.to_numpy(dtype=float)
    known = known[np.isfinite(known)]
    count = len(known)
    mean = float(known.mean()) if count else np.nan
    error = float(known.std(ddof=1) / np.sqrt(count)) if count > 1 else np.nan
    return {"mean": mean, "error": error, "members": count}
