"""Pair laws and their sum over the cluster list: truncations, mixtures, exclusions, slopes, and steps in the clusters' order.

Imports `laws` and `lists`. Users meet it as `kd.pair_law` and `kd.LennardJones`.
"""
