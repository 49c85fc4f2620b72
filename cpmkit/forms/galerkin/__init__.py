"""The Galerkin form: splines on the lattice, the energy summed over samples of the surface. Still to be built."""
