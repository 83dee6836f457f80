"""Attacks, measurements, and programs for the docs' pictures and tables: `python -m benchmarks` lists them. Not installed."""


class UsageError(Exception):
    """A command was called with invalid arguments."""
