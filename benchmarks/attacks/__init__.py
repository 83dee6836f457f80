"""Random cases against independent references, one module for each subject: `python -m benchmarks attack SUBJECT` runs them."""
