"""Tests: of each room, over the registries, slow ones, and those beside other implementations."""
