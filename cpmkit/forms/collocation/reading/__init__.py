"""Reading values and gradients at points of the manifold."""
