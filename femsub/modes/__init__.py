"""Undamped modes (K - ω²M)φ = 0, dense and sparse.

In: K and M. Out: frequencies and shapes, each with its residual, and the number of modes by an independent count (inertia).
"""
