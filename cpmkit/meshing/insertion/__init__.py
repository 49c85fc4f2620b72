"""Boundaries inserted as edges of the mesh, one point at a time; the mesh is valid after every step.

Edges of earlier boundaries are ordinary edges when a later curve is inserted: crossings, branches and one-sided
surfaces need no rule of their own.
"""
