"""Export to formats of other programs.

Imports `read`. The command line and `kickdrift.export` use `export`.
"""
