"""The manifold as a mesh whose edges lie along the boundaries: contouring of closest points, insertion of curves."""
