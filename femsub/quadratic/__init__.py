"""Complex modes (λ²M + λD + K)x = 0, dense and sparse: contacts, region, search with its certificate, bars.

In: a pencil. Out: eigenpairs with backward errors, error bars and counts.
"""
