"""The Cartesian side of the method: lattice, band, interpolation stencils, and the choice of a spacing."""
