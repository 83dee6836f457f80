"""Files: matrices, meshes and model folders, each read whole and checked, written whole or not at all."""
