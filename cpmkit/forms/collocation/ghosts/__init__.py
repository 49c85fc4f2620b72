"""Ghosts of a boundary: where they stand and what they read."""
