"""Finite elements on triangles or segments: a reference that shares no stencil with the closest point method."""

from cpmkit_fem import plugin
from cpmkit_fem.backend import fem, fem_pinned
from cpmkit_fem.form import FiniteElements
from cpmkit_fem.work import FemWork

__all__ = ["FemWork", "FiniteElements", "fem", "fem_pinned", "plugin"]
