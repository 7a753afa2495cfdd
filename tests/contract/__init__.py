"""Tests over the registries: what every method, force, system and engine keeps."""
