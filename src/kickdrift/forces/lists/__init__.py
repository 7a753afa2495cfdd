"""Lists of neighbours: clusters of eight particles, their search, upkeep and rows.

Knows positions, boxes and cutoffs, but no law; imports `seam`. Pair forces, many-body forces and slopes use it.
"""
