"""Limit cycles: harmonic balance, shooting, branches and their stability.

In: a model and its belts. Out: limit cycles with residual, neglected harmonics and Floquet multipliers.
"""
