"""Tests over the registries: rules for every method, force, system and engine."""
