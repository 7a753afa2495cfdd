"""The methods of the documentation's page on integrators of one's own, which the contract tests run too."""

import re
import sys
from types import ModuleType

from tests.folders import DOCS

PAGE = DOCS / "your-own-integrator.md"
NAMES = ("mclachlan-atela2", "heun", "my-verlet")


def page_code() -> str:
    """The page's Python."""
    return "\n".join(re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL))


def registrations() -> str:
    """The part that registers, without the run."""
    return page_code().split("\nif __name__")[0]


def register() -> None:
    """Register the page's methods, in a module that numba can name in its cache."""
    page = ModuleType("page")
    sys.modules["page"] = page
    exec(compile(registrations(), str(PAGE), "exec"), vars(page))
