"""Linear algebra that knows no model: factors, orderings, elimination, null spaces, memory and threads.

In: matrices. Out: factors, which solve and count negative eigenvalues. `petsc.py` alone imports petsc4py and slepc4py.
"""
