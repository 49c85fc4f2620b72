"""Points, segments, circles, arcs, spheres, caps, tori, cylinders and boxes with closest points in closed form."""

from cpmkit_analytic import plugin
from cpmkit_analytic.factories import arc, box, cap, circle, cylinder, point, segment, sphere, torus

__all__ = ["arc", "box", "cap", "circle", "cylinder", "plugin", "point", "segment", "sphere", "torus"]
