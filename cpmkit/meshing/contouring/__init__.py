"""Meshes of manifolds known by closest points alone: dual contouring of surfaces without a sign, traces of curves."""
