"""The kind ``svg.path``: one curve of an SVG file in the plane."""

from __future__ import annotations

from pathlib import Path

from cpmkit.plugin import ClosestPointSource, InputError, shown, source, whole
from cpmkit_svg.drawing import read_drawing
from cpmkit_svg.flattening import flatten_cubics
from cpmkit_svg.path_data import subpaths


def path(
    *, file: str | Path | None = None, id: str | None = None, d: str | None = None, subpath: int | None = None
) -> ClosestPointSource:
    """Return a curve of an SVG file, or of path data, as a polyline that deviates by 1e-5 of the curve's size at most.

    It runs as it is drawn, with its left at your left hand as you see the drawing.

    Parameters
    ----------
    file : str or Path
        An SVG file. The curve lies in the plane with y upwards, so that the drawing stands on its feet: the canvas
        keeps its place, and y becomes the sum of its upper and lower end less y.
    id : str
        Of the path in the file, or of another shape; transforms of it and of groups about it are applied. May be left
        out where the file has one curve alone.
    d : str
        Instead of a file, path data, in coordinates of the plane as they stand.
    subpath : int, optional
        Which of the path's curves, from 0; needed where it has several.

    Raises
    ------
    InputError
        If both or neither of ``file`` and ``d`` are given, or ``id`` with ``d``; if the file cannot be read, data are
        damaged, there is no such curve, or there are several and ``subpath`` is not given.
    """
    if (file is None) == (d is None) or (d is not None and id is not None):
        raise InputError("svg.path takes a file, with the id of a path in it, or path data d, and not both.")
    if file is None:
        curves = [(flatten_cubics(curve.cubics), curve.closed) for curve in subpaths(str(d), "d")]
        label = "the path data"
    else:
        drawn = read_drawing(file).curves
        curves = [(curve.points, curve.closed) for curve in drawn if id is None or curve.element == id]
        label = f"{shown(Path(file).name)}" if id is None else f"path {shown(id)} of {shown(Path(file).name)}"
        if not curves:
            known = ", ".join(shown(curve.element) for curve in drawn if curve.element)[:200]
            raise InputError(f"{label} draws no curve; the ids of those that are drawn are {known or 'none'}.")
    if not curves:
        raise InputError(f"{label} draw no curve.")
    if subpath is None and len(curves) > 1:
        choose = "give its id, and subpath" if file is not None and id is None else "give subpath"
        raise InputError(f"{label} draws {len(curves)} curves; {choose} from 0 to {len(curves) - 1}.")
    points, closed = curves[whole(0 if subpath is None else subpath, "subpath", 0, len(curves) - 1)]
    return source("mesh.polyline", points=points, closed=closed)
