"""Files of matrices, meshes and models, each read whole and checked, and written whole or not at all.

In: a path. Out: matrices, a `Mesh` or a `Substructure`; and the same the other way.
"""
