"""``python -m kickdrift``: the command line."""

from kickdrift.cli import main

main()
