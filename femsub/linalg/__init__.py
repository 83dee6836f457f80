"""Factors, orderings, memory and threads; the one module that imports petsc4py and slepc4py.

In: matrices. Out: factors, which solve and count negative eigenvalues.
"""
