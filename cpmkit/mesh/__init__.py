"""Meshes: edges, rims, winding, normals, repair, subdivision, clips at knot planes, quadrature, cuts at boundaries."""
