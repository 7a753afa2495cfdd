"""Tests that start other processes, kill them, or try many cases."""
