"""The manifold as a mesh with boundaries as edges: contouring, insertion of boundaries, curved cells, and warnings."""
