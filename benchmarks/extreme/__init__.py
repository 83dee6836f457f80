"""The stiff and extreme cases of `python -m benchmarks extreme`: models, references, verdicts."""
