"""Random cases against references of their own, a module per subject: `python -m benchmarks attack SUBJECT` runs them."""
