"""Eigenvalues: the pairs themselves, and how near a driven problem comes to one."""
