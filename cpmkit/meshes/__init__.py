"""Meshes for pictures and quadrature: cells, cuts along boundaries, refinement."""
