"""What a run says of itself: conservation, temperature, cost, warnings, and the lines that people read.

Imports no other part of a run. The loop, the files and the watchers use it.
"""
