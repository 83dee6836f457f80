"""How parts meet: joints, ties and rigid links between them, cuts through them, and contacts that slide.

In: substructures and joints. Out: a `System`, which is a `Substructure` again.
"""
