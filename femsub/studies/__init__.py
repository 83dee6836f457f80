"""Comparisons of models: error against run time, and quality under self-excitation. In: models. Out: tables."""
