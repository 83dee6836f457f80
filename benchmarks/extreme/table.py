"""All extreme cases by name: each stands in the module of the functions that judge it."""

from __future__ import annotations

from benchmarks.extreme import cases, complex, continua, motion, reduction, spectra

__all__ = ["CASES", "complex", "continua", "motion", "reduction", "spectra"]

CASES = cases.CASES
