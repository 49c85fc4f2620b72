"""The Galerkin form: quadratic splines on the lattice, the energy summed over samples of the manifold.

u on the manifold S is a spline of lattice coefficients; its energy is a sum over samples of S, which are points with
weights and normals. What of a spline's support belongs together is told by the samples' mesh alone: cut along the
boundaries, a node has as many unknowns as its support meets separate pieces of S.
"""
