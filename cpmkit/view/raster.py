"""The renderer: triangles filled into pixels, the nearest on top, the values of a pixel interpolated before colouring.

It needs neither a display nor OpenGL, and draws the same picture on every machine.
"""

from __future__ import annotations

import numpy as np

from cpmkit.protocols import Floats, Ints
from cpmkit.runtime.threads import run_parcels
from cpmkit.view.colours import Bar
from cpmkit.view.drawing import Drawing
from cpmkit.view.raster_kernel import fill
from cpmkit.view.shapes import Shapes

#: Share of its colour that a face keeps where no light falls; the light brings the rest.
AMBIENT = 0.5
#: Where the light comes from, in the picture's axes: over the viewer's left shoulder.
LIGHT = np.array((-0.35, 0.5, 1.0)) / np.linalg.norm((-0.35, 0.5, 1.0))
#: Each pixel is the mean of so many by so many.
SAMPLES = 3
#: Rows of pixels that are filled at once.
STRIP_ROWS = 48


def pixels(drawing: Drawing, values: Floats, bar: Bar | None, ink: Shapes) -> Floats:
    """Return the picture (rows, columns, 3), from 0 to 1, of a drawing with given values.

    Parameters
    ----------
    drawing : Drawing
    values : (v, 1) or (v, 3) float64
        At the mesh's vertices: what ``bar`` explains, or colours.
    bar : Bar or None
    ink : Shapes
        Drawn over it in colours of their own, each at its place before the model.
    """
    paint = values if bar is None else bar.shares(values)
    paint = np.ascontiguousarray(np.clip(paint, 0, 1)[drawing.owner])
    table = np.zeros((1, 3)) if bar is None else bar.table
    none = np.zeros((0, 3))
    normals = drawing.normals if drawing.lit else none
    signs = seen_side(drawing.points, drawing.triangles, normals) if drawing.lit else none
    columns, rows = (SAMPLES * drawing.camera.pixels).tolist()
    scale = columns / (2 * drawing.camera.half[0])
    origin = np.array([columns / 2, rows / 2, 0.0])

    def placed(points: Floats) -> Floats:
        return np.asarray(points * [scale, -scale, scale] + origin)

    corners, over = placed(drawing.points), placed(ink.points)
    picture = np.empty((rows // SAMPLES, columns // SAMPLES, 3))

    def strip(start: int, stop: int) -> None:
        shape = (SAMPLES * (stop - start), columns)
        depth, image = np.full(shape, -np.inf), np.ones((*shape, 3))
        first = SAMPLES * start
        fill(corners, drawing.triangles, paint, table, normals, signs, LIGHT, AMBIENT, first, depth, image)
        fill(over, ink.triangles, ink.colours, table, none, none, LIGHT, AMBIENT, first, depth, image)
        picture[start:stop] = image.reshape(stop - start, SAMPLES, -1, SAMPLES, 3).mean(axis=(1, 3))

    run_parcels(strip, len(picture), STRIP_ROWS)
    return picture


def seen_side(points: Floats, triangles: Ints, normals: Floats) -> Floats:
    """Return what turns the normal (v, 3) at each corner of triangles (t, 3) to the side that is seen: (t, 3), 1 or -1.

    Both sides of a surface are lit alike, and its normals need not be of one side: a Moebius strip has none that are.
    """
    a, b, c = (points[triangles[:, k]] for k in range(3))
    face = np.cross(b - a, c - a)
    face *= np.where(face[:, 2:] < 0, -1.0, 1.0)
    return np.where(np.einsum("tkd,td->tk", normals[triangles], face) < 0, -1.0, 1.0)
