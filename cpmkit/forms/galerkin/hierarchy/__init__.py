"""The same splines on coarser lattices, for a multigrid: two cells an axis make one, and what touched still does."""
