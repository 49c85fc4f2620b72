"""Solids in the Galerkin form: their skin as an oriented mesh, their patches and quadrature, and evaluation."""
