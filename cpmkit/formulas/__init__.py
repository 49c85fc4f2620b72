"""Formulas in x, y, z, t as checked syntax trees: values and derivatives, without executing code."""
