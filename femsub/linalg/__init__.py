"""Factors, orderings, memory and threads; the one module that imports petsc4py and slepc4py.

In: matrices. Out: handles that solve and count.
"""
