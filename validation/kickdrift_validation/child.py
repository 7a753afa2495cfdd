"""One script's claims, a line of JSON each, for the runner that started this process.

    python -m kickdrift_validation.child MODULE FOLDER [--long]

Standard output is for the claims alone; what the script prints goes where its messages go. Figures go to FOLDER.
"""

import json
import os
import sys
from importlib import import_module
from pathlib import Path
from typing import Any


def plain(value: Any) -> Any:
    """What JSON has no word for: numbers of NumPy, and the rest as text."""
    return value.item() if hasattr(value, "item") else str(value)


def main(module: str, figures: Path, long: bool) -> None:
    with os.fdopen(os.dup(1), "w", encoding="utf-8") as out:
        os.dup2(2, 1)
        from kickdrift_validation.claim import of

        for row in of(import_module(module).claims, long, figures):
            print(json.dumps(row, default=plain), file=out, flush=True)


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]), "--long" in sys.argv[3:])
