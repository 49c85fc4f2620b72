"""Triangles and segments on manifolds that are known by closest points alone: dual contouring without a sign."""
