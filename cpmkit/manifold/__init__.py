"""S by its closest points alone, without a lattice: feet, tangent spaces, orientation, walks along it."""
