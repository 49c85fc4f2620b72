"""Truncated hierarchical splines, and their adaptive refinement by the residual."""
