"""Tests: unit tests by layer, contract tests over the registries, slow tests, and tests against other
implementations."""
