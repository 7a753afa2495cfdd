"""Parameters of tests, of which the short set takes some and the long set the rest."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import Any

import pytest


def shortened(values: Iterable[Any], short: Collection[Any]) -> list[Any]:
    """All values; those that are not in ``short`` run with the long tests."""
    listed = list(values)
    assert all(each in listed for each in short), f"not all of {short} are among the values"
    return [each if each in short else rest(each) for each in listed]


def rest(*values: Any) -> Any:
    """A test's parameters for the long set alone."""
    return pytest.param(*values, marks=pytest.mark.long)
