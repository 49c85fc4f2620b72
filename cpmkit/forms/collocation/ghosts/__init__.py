"""Ghosts of a boundary: their positions, and the formulas of their values."""
