"""Quadrature points with weights and normals on the cells of a mesh, between the knot planes of the lattice."""
