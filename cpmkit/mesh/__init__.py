"""Meshes: cells, edges, rims, winding, normals, repair, subdivision, clipping, quadrature and cuts along boundaries."""
