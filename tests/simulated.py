"""Tests of the engine cuda run on numba's simulator of a device, in a process of their own: see contract/test_cuda.py.

As a plugin of pytest, this module lets the simulator stand for numba-cuda.
"""

from __future__ import annotations

import os
from importlib import import_module
from typing import Any

import pytest

SIMULATED = os.environ.get("NUMBA_ENABLE_CUDASIM") == "1"
WITHOUT_DEVICE = pytest.mark.skipif(not SIMULATED, reason="test_cuda.py runs this on a simulated device")


def marked(engine: str, value: Any = None, name: str | None = None) -> Any:
    """A parameter for an engine, by default its name; cuda's runs on a simulated device alone."""
    value, marks = engine if value is None else value, WITHOUT_DEVICE if engine == "cuda" else ()
    return pytest.param(value, id=name or engine, marks=marks)


if SIMULATED:
    registry = import_module("kickdrift.engines")
    version = registry._version
    registry._version = lambda package: version(package) or ("0.simulator" if package == "numba-cuda" else None)
