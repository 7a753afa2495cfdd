"""``python -m kickdrift_validation``: the same as ``kickdrift validate``."""

import sys

from kickdrift.cli.main import main

sys.argv.insert(1, "validate")
main()
