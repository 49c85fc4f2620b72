"""The Galerkin form: splines of a lattice on the manifold, with the energy summed over quadrature samples."""
