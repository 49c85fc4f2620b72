"""Curves x(t) and surfaces x(u, v) from formulas or callables, as closest point sources."""

from cpmkit_parametric import plugin
from cpmkit_parametric.factories import curve, surface
from cpmkit_parametric.shapes import helix, klein, moebius, planar_curve, revolution, torus_knot

__all__ = ["curve", "helix", "klein", "moebius", "planar_curve", "plugin", "revolution", "surface", "torus_knot"]
