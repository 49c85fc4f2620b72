"""The problem: a manifold, boundaries inside it, conditions and their laws, an equation. No lattice."""
