"""The Cartesian side of the method: lattice, band, stencils, and reading a band at surface points."""
