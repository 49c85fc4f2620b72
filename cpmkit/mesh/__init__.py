"""Meshes: edges, rims, orientation, normals, repair, subdivision, quadrature, and cuts at boundaries."""
