"""Where the scripts find their data, and the checkout that they belong to."""

from pathlib import Path

HERE = Path(__file__).resolve().parent
DATA = HERE / "data"
_TOP = HERE.parents[1]
# The top folder of a checkout; None where the scripts are installed without one.
CHECKOUT = _TOP if HERE.parent == _TOP / "validation" and (_TOP / "pyproject.toml").is_file() else None


def checkout() -> Path:
    """Return the top folder of the checkout.

    Raises
    ------
    SystemExit
        With one line, where there is no checkout.
    """
    if CHECKOUT is None:
        raise SystemExit("this script works on a checkout of kickdrift, and these files are installed without one")
    return CHECKOUT
