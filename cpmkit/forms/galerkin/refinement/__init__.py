"""Splines that are finer where a solution asks for it: truncated hierarchical splines on the patches of all levels."""
