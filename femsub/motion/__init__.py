"""Nonlinear motion in time. In: a model and its belts. Out: transients and what signals tell."""
