"""Python in a separate process that finds the tests and both packages."""

import os
import subprocess
import sys

from tests.folders import TOP


def python(code: str, timeout: float = 300, **settings: str) -> subprocess.CompletedProcess[str]:
    """Run the code at the top of the checkout, with these settings in the environment."""
    return subprocess.run(
        [sys.executable, "-c", code], cwd=TOP, env=os.environ | settings, capture_output=True, text=True,
        timeout=timeout, check=False,
    )  # fmt: skip
