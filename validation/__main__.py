"""``python -m validation``: the same as ``kickdrift validate``, with the scripts of this folder."""

import sys
from pathlib import Path

from kickdrift.cli import main as cli

cli.VALIDATION = Path(__file__).parent
sys.argv.insert(1, "validate")
cli.main()
