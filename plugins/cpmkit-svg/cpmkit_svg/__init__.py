"""Curves of SVG files as closest point sources, and whole drawings as scenes of diffusion curves."""

from cpmkit_svg import plugin
from cpmkit_svg.drawing import Drawing, DrawnCurve, read_drawing
from cpmkit_svg.path import path
from cpmkit_svg.scene import draw, drawing_scene

__all__ = ["Drawing", "DrawnCurve", "draw", "drawing_scene", "path", "plugin", "read_drawing"]
