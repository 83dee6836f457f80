"""Nonlinear motion in time. In: a model and its belts. Out: transients, and the evaluation of signals."""
