"""The program that lowers the loops of a page, in a process of its own: ``python -m kickdrift.pages.build NAME``.

It writes the page's module to standard output, as JSON. numba must not optimise anything in this process.
"""

import json
import sys

from kickdrift.errors import KickdriftError
from kickdrift.pages.lowering import own_process


def main() -> None:
    """Lower the loops of the page that the command line names."""
    own_process()
    from kickdrift.pages.module import Module
    from kickdrift.pages.shipped import page_of

    module = Module()
    try:
        runs = page_of(sys.argv[1]).runs(module)
        made = {**module.written(), "runs": runs}
    except KickdriftError as error:
        sys.exit(str(error))
    json.dump(made, sys.stdout, separators=(",", ":"))


if __name__ == "__main__":
    main()
