"""Manifolds by closest points: sources, tangents, orientation, walks; inner products, norms, rotations of vectors."""
