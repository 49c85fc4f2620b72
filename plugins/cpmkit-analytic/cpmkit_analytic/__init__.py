"""Points, segments, circles, arcs, spheres, caps, tori and cylinders with closest points in closed form."""

from cpmkit_analytic import plugin
from cpmkit_analytic.factories import arc, cap, circle, cylinder, point, segment, sphere, torus

__all__ = ["arc", "cap", "circle", "cylinder", "plugin", "point", "segment", "sphere", "torus"]
