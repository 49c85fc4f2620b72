"""A whole drawing as a scene of diffusion curves, and its colours as a picture."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from cpmkit.plugin import (
    Boundary,
    Dirichlet,
    Floats,
    InputError,
    Laplace,
    Neumann,
    Scene,
    Solution,
    VertexData,
    shown,
    solve,
    source,
    whole,
    write_png,
)
from cpmkit_svg.clipping import PolylinePiece, clip_polyline
from cpmkit_svg.drawing import Drawing, DrawnCurve, read_drawing
from cpmkit_svg.gradients import Stops

#: Default spacing of the lattice, over the larger side of the canvas.
SPACING_SHARE = 1 / 200
#: Number of pixels evaluated at once: it bounds temporary memory.
BATCH_PIXELS = 200_000


def drawing_scene(file: str | Path | Drawing) -> Scene:
    """Return the scene of the diffusion curves of a drawing or its SVG file: three channels, harmonic between curves.

    The Dirichlet values on both sides of a curve are the colour of its ``stroke``; ``data-left`` and ``data-right``
    replace it on one side. Each is a colour, ``url(#id)`` of a gradient, whose stops are then shares of the curve's
    length, or ``none`` for a side without flux. Curves without a colour on either side are omitted. The plane and the
    curves end at the canvas, which has no flux at its edge. Raise InputError if the file cannot be read, or no curve on
    the canvas has a colour.
    """
    drawing = file if isinstance(file, Drawing) else read_drawing(file)
    coloured_curves = [curve for curve in drawing.curves if curve.coloured]
    if not coloured_curves:
        raise InputError("no curve of the drawing has a stroke, data-left or data-right; give one a colour.")
    lower, upper = drawing.canvas
    boundaries = [boundary for curve in coloured_curves for boundary in _boundaries(curve, lower, upper)]
    if not boundaries:
        raise InputError("no curve with a colour passes over the canvas; compare the viewBox with the curves.")
    return Scene(source("analytic.box", lower=lower.tolist(), upper=upper.tolist()), Laplace(), boundaries)


def draw(
    file: str | Path, png: str | Path, *, width: int = 800, spacing: float | None = None, **options: Any
) -> Solution:
    """Solve the diffusion curves of an SVG file and write their colours over the canvas as a PNG file.

    Parameters
    ----------
    file, png : path
        The SVG file, and the PNG file to write.
    width : int
        In pixels, from 1 to 16,384; the height is that of the canvas in proportion.
    spacing : float, optional
        Of the lattice, in the drawing's unit; by default a two-hundredth of the canvas' larger side. Colours of curves
        nearer to each other than a few spacings mix.
    **options
        Of :func:`cpmkit.solve`.

    Returns
    -------
    Solution
        Three channels: red, green and blue, from 0 to 1, as functions of points in the drawing's unit, y upwards.

    Raises
    ------
    InputError
        If the SVG file cannot be read, no curve on the canvas has a colour, an argument is not accepted, or the PNG
        file cannot be written.
    ResolutionError, ConvergenceError
        As :func:`cpmkit.solve`.
    """
    if Path(png).suffix.lower() != ".png":
        raise InputError(f"A picture must be a .png file, got {shown(Path(png).name)}.")
    columns = whole(width, "width in pixels", 1, 16384)
    drawing = read_drawing(file)
    lower, upper = drawing.canvas
    across, up = upper - lower
    solution = solve(drawing_scene(drawing), SPACING_SHARE * max(across, up) if spacing is None else spacing, **options)
    rows = max(round(columns * up / across), 1)
    x = lower[0] + (np.arange(columns) + 0.5) * across / columns
    y = upper[1] - (np.arange(rows) + 0.5) * up / rows
    points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    parts = [solution.evaluate(points[k : k + BATCH_PIXELS]) for k in range(0, len(points), BATCH_PIXELS)]
    write_png(png, np.concatenate(parts).reshape(rows, columns, 3))
    return solution


def _boundaries(curve: DrawnCurve, lower: Floats, upper: Floats) -> list[Boundary]:
    """Return a boundary for each piece of a curve on the canvas, whose corners are ``lower`` and ``upper`` (2,)."""
    pieces = clip_polyline(curve.points, lower, upper)
    uncut = len(pieces) == 1 and len(pieces[0].points) == len(curve.points)
    names = [curve.name] if len(pieces) == 1 else [f"{curve.name}, piece {k}" for k in range(len(pieces))]
    return [_boundary(curve, name, piece, curve.closed and uncut) for name, piece in zip(names, pieces, strict=True)]


def _boundary(curve: DrawnCurve, name: str, piece: PolylinePiece, closed: bool) -> Boundary:
    """Return the boundary ``name`` of a ``piece`` of ``curve``: Dirichlet with its colours, no flux on a side without.

    ``closed`` says whether the last point of the piece is connected to its first.
    """
    polyline = source("mesh.polyline", points=piece.points, closed=closed)

    def condition(stops: Stops | None) -> Any:
        return Neumann(0.0) if stops is None else Dirichlet(VertexData(polyline, stops.colours_at(piece.shares)))

    if curve.left is curve.right:
        return Boundary(name, polyline, both=condition(curve.left))
    return Boundary(name, polyline, left=condition(curve.left), right=condition(curve.right))
