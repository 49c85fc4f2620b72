"""Truncated hierarchical splines: regions of finer splines, graded meshes, and the refined function space."""
