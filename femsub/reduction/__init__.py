"""Reduced models: one file for each method.

In: a `Substructure`. Out: a `ReducedSubstructure`, which is a `Substructure` again.
"""
