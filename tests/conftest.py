"""Before tests are collected: the methods of the docs' page are registered, so that every contract test is theirs."""

from __future__ import annotations

import os
import re
import sys
from pathlib import Path
from types import ModuleType

# Before NumPy is loaded: two test processes whose BLAS threads wait for each other take many times as long.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

PAGE = Path(__file__).parents[1] / "docs" / "your-own-integrator.md"


def page_code() -> str:
    """The Python of the docs' page on integrators of one's own."""
    return "\n".join(re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL))


def registrations() -> str:
    """The part that registers, without the run."""
    return page_code().split("\nif __name__")[0]


page = ModuleType("page")  # a module that numba can name in its cache
sys.modules["page"] = page
exec(compile(registrations(), str(PAGE), "exec"), vars(page))
