"""Unions of members of different dimension: a function space for each dimension, and the junctions between them."""
