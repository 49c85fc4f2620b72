"""Formulas in x, y, z, t as bounded trees: values, derivatives, no code executed."""
