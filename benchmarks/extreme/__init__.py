"""The stiff and extreme cases of scripts/extreme.py: models, references in many digits, and the verdict on each case."""
