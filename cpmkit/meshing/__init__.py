"""The manifold as a mesh with the boundaries as its edges: contouring, insertion, curved cells, untangling."""
