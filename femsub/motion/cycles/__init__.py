"""Limit cycles: harmonic balance, shooting, branches and their stability.

In: a model and its belts. Out: cycles with their evidence.
"""
