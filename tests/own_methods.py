"""Methods of the documentation's page on the user's own integrators, for the contract tests."""

import re
import sys
from types import ModuleType

from tests.folders import DOCS

PAGE = DOCS / "your-own-integrator.md"
NAMES = ("mclachlan-atela2", "heun", "my-verlet")


def page_code() -> str:
    """Python code of the page."""
    return "\n".join(re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL))


def registrations() -> str:
    """Part of the page's code that registers methods, without the run."""
    return page_code().split("\nif __name__")[0]


def register() -> None:
    """Register the page's methods in a module with a name, which numba's cache needs."""
    page = ModuleType("page")
    sys.modules["page"] = page
    exec(compile(registrations(), str(PAGE), "exec"), vars(page))
