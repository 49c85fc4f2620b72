"""Formulas in x, y, z, t as checked syntax trees: their values and derivatives, without executing code."""
