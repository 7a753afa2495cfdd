"""``python -m kickdrift``: the command line."""

from kickdrift.cli.main import main

main()
