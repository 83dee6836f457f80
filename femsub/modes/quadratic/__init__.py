"""Complex modes (λ²M + λD + K)x = 0, dense and sparse: contacts, region, search, proof of completeness, error bars.

In: a pencil. Out: eigenpairs with backward errors and error bars, and independent counts of eigenvalues.
"""
