"""The manifold as a mesh with the boundaries as its edges: source cells, contouring, insertion, curved cells, cuts."""
