"""The problem: a manifold from a source or an object, boundaries inside it, conditions and laws, an equation."""
