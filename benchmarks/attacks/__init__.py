"""Random cases against references of their own, a module per subject: `scripts/attack.py SUBJECT` runs them."""
