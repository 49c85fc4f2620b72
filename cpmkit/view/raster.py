"""The renderer: triangles filled into pixels, the nearest on top, the values of a pixel interpolated before colouring.

It needs neither a display nor OpenGL, and draws the same picture on every machine.
"""

from __future__ import annotations

import numpy as np

from cpmkit.protocols import Floats
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
    normals = drawing.normals if drawing.lit else np.zeros((0, 3))
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
        none = np.zeros((0, 3))
        first = SAMPLES * start
        fill(corners, drawing.triangles, paint, table, normals, LIGHT, AMBIENT, first, depth, image)
        fill(over, ink.triangles, ink.colours, table, none, LIGHT, AMBIENT, first, depth, image)
        picture[start:stop] = image.reshape(stop - start, SAMPLES, -1, SAMPLES, 3).mean(axis=(1, 3))

    run_parcels(strip, len(picture), STRIP_ROWS)
    return picture
