"""What a user states: a manifold, boundaries with their conditions, an equation. No lattice."""
