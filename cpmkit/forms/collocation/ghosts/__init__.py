"""Ghosts of a boundary: where they stand, and the formulas of their values."""
