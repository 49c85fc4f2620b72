"""The Galerkin form: splines of a lattice restricted to the manifold, with integrals by quadrature samples."""
