"""Manifolds by closest points: sources, tangents, orientation, walks; unions of mixed dimension; vector algebra."""
