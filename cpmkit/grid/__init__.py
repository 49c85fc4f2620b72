"""The Cartesian side of the method: lattice, band, stencils, reading a band at points, and the choice of a spacing."""
