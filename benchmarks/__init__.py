"""Attacks, measurements, and what makes the pictures and tables of the docs: `python -m benchmarks` lists them. Not installed."""


class UsageError(Exception):
    """A command was called in a way that it cannot follow."""
