"""The conditions of a scene as terms of matrix and load, at samples on boundaries and rims."""
