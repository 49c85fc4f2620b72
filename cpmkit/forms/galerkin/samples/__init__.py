"""Cells of the manifold made sound, split, curved and cut, and the samples that are drawn from them."""
