"""Components made here: chain, beam, plate, solid, and their meshes. In: geometry and material. Out: a `Substructure`."""
