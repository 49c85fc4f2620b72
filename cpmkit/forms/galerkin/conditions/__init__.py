"""The conditions of a scene as terms of the matrix and the load, summed over samples on boundaries and rims."""
