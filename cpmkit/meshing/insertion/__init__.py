"""Boundaries made edges of the mesh, one point at a time; the mesh is valid after every step.

Curves inserted before are ordinary edges to those that come after: crossings, branches, coincident pieces and one-sided
surfaces need no rule of their own.
"""
