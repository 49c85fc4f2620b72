"""Splines that are finer where the solution asks for it: truncated hierarchical splines on the patches of all levels."""
