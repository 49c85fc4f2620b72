"""Families of equations, written over any form."""
