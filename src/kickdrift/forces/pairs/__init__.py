"""Pair laws and their sum over the cluster list: truncations, mixtures, exclusions, slopes, steps in sorted order.

Imports `laws` and `lists`. Users meet it as `kd.pair_law` and `kd.LennardJones`.
"""
