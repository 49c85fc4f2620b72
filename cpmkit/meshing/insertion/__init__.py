"""Boundaries made edges of the sample mesh, one point at a time; the mesh is valid after every step.

Curves that were inserted before are ordinary edges to those that come after, so that crossings, branches, figures
eight, coincident pieces and one-sided surfaces need no rule of their own.
"""
