"""Splitting methods: words over flows with their weights, run by one loop.

Imports `stepping`; heat baths and barostats are flows of its words. `constant_temperature` has the methods with a bath.
"""
