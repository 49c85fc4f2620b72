"""The manifold as a mesh with boundaries as edges: contouring, insertion, curving, untangling, warnings on the mesh."""
