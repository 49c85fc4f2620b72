"""Splines on the lattice over samples of the manifold: which unknowns there are, and the matrices of their energies."""
