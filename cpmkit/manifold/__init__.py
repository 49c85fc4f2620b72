"""Manifolds by closest points: sources and their abilities, tangents, orientation, unions; and vector algebra."""
