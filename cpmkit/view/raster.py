"""The renderer, which fills triangles into pixels: values are interpolated, then coloured; the nearest is on top.

The renderer needs neither a display nor OpenGL, and draws the same picture on every machine.
"""

from __future__ import annotations

import numpy as np

from cpmkit.runtime.compilation import compiled, run_parcels
from cpmkit.types import Floats, Ints
from cpmkit.view.colours import Bar
from cpmkit.view.drawing import Drawing, Shapes


@compiled
def rasterize_triangles(
    corners: Floats,
    triangles: Ints,
    paint: Floats,
    table: Floats,
    normals: Floats,
    signs: Floats,
    light: Floats,
    ambient: float,
    first_row: int,
    depth: Floats,
    image: Floats,
) -> None:
    """Draw triangles into the rows of an image, at the pixels where they are nearer to the viewer than its ``depth``.

    ``corners`` (v, 3): column and row from the whole picture's upper left corner, in pixels of ``image``, and height.
    ``triangles`` (t, 3): the vertices at their corners.
    ``paint`` (v, 3) or (v, 1): colours of the vertices, or their places from 0 to 1 in ``table`` (k, 3).
    ``normals`` (v, 3): normals: to the right, up and towards the viewer; no rows if the triangles are not shaded.
    ``signs`` (t, 3): 1 or -1 for each corner of a triangle: the factor that turns its normal to the visible side.
    ``light`` (3,): unit vector towards the light.
    ``ambient``: share of its colour that a face keeps where no light falls.
    ``first_row``: number in the whole picture of the first row of ``depth`` and ``image``.
    ``depth`` (rows, columns): height towards the viewer of the nearest triangle so far; changed in place.
    ``image`` (rows, columns, 3): colours; changed in place.
    """
    rows, columns = depth.shape
    channels, lit = paint.shape[1], len(normals) > 0
    colour, normal = np.empty(3), np.empty(3)
    for t in range(len(triangles)):
        i, j, k = triangles[t]
        ax, ay = corners[i, 0], corners[i, 1] - first_row
        bx, by = corners[j, 0], corners[j, 1] - first_row
        cx, cy = corners[k, 0], corners[k, 1] - first_row
        area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
        if area == 0:
            continue
        top, bottom = max(int(np.ceil(min(ay, by, cy) - 0.5)), 0), min(int(np.floor(max(ay, by, cy) - 0.5)), rows - 1)
        left = max(int(np.ceil(min(ax, bx, cx) - 0.5)), 0)
        right = min(int(np.floor(max(ax, bx, cx) - 0.5)), columns - 1)
        for row in range(top, bottom + 1):
            y = row + 0.5
            for column in range(left, right + 1):
                x = column + 0.5
                v = ((x - ax) * (cy - ay) - (cx - ax) * (y - ay)) / area
                w = ((bx - ax) * (y - ay) - (x - ax) * (by - ay)) / area
                u = 1.0 - v - w
                if u < -1e-9 or v < -1e-9 or w < -1e-9:
                    continue
                distance = u * corners[i, 2] + v * corners[j, 2] + w * corners[k, 2]
                if distance <= depth[row, column]:
                    continue
                depth[row, column] = distance
                factor = 1.0
                if lit:
                    length, along = 0.0, 0.0
                    su, sv, sw = u * signs[t, 0], v * signs[t, 1], w * signs[t, 2]
                    for axis in range(3):
                        normal[axis] = su * normals[i, axis] + sv * normals[j, axis] + sw * normals[k, axis]
                        length += normal[axis] ** 2
                        along += normal[axis] * light[axis]
                    factor = ambient + (1 - ambient) * max(along / np.sqrt(length), 0.0) if length > 0 else 1.0
                if channels == 1:
                    share = u * paint[i, 0] + v * paint[j, 0] + w * paint[k, 0]
                    entry = int(share * (len(table) - 1) + 0.5)
                    for axis in range(3):
                        colour[axis] = table[entry, axis]
                else:
                    for axis in range(3):
                        colour[axis] = u * paint[i, axis] + v * paint[j, axis] + w * paint[k, axis]
                for axis in range(3):
                    image[row, column, axis] = factor * colour[axis]


#: Ambient share of a face's colour; the light adds the rest.
AMBIENT = 0.5
#: Direction to the light, in the picture's axes: over the viewer's left shoulder.
LIGHT = np.array((-0.35, 0.5, 1.0)) / np.linalg.norm((-0.35, 0.5, 1.0))
#: A pixel is the mean of SAMPLES by SAMPLES samples.
SAMPLES = 3


def rasterize_drawing(drawing: Drawing, values: Floats, bar: Bar | None, ink: Shapes) -> Floats:
    """Return the picture (rows, columns, 3), from 0 to 1, of a drawing with ``values`` at the mesh's vertices.

    ``values`` (v, 1): on the scale of ``bar``; or, if it is None, (v, 3): colours from 0 to 1.
    ``ink``: shapes with colours of their own, drawn at their depth together with the model.
    """
    paint = values if bar is None else bar.shares(values)
    paint = np.ascontiguousarray(np.clip(paint, 0, 1)[drawing.owner])
    table = np.zeros((1, 3)) if bar is None else bar.table
    none = np.zeros((0, 3))
    normals, signs = none, none
    if drawing.lit:  # both sides are shaded equally, and normals need not be oriented, as on a Moebius strip
        normals = drawing.normals
        a, b, c = (drawing.points[drawing.triangles[:, k]] for k in range(3))
        face = np.cross(b - a, c - a)
        face *= np.where(face[:, 2:] < 0, -1.0, 1.0)
        signs = np.where(np.einsum("tkd,td->tk", normals[drawing.triangles], face) < 0, -1.0, 1.0)
    columns, rows = (SAMPLES * drawing.camera.pixels).tolist()
    scale = columns / (2 * drawing.camera.half[0])
    origin = np.array([columns / 2, rows / 2, 0.0])
    corners, over = (points * [scale, -scale, scale] + origin for points in (drawing.points, ink.points))
    picture = np.empty((rows // SAMPLES, columns // SAMPLES, 3))

    def fill_rows(start: int, stop: int) -> None:
        """Fill the rows from ``start`` to ``stop`` of the picture, each pixel with the mean of its samples."""
        shape = (SAMPLES * (stop - start), columns)
        depth, image = np.full(shape, -np.inf), np.ones((*shape, 3))
        first = SAMPLES * start
        rasterize_triangles(
            corners, drawing.triangles, paint, table, normals, signs, LIGHT, AMBIENT, first, depth, image
        )
        rasterize_triangles(over, ink.triangles, ink.colours, table, none, none, LIGHT, AMBIENT, first, depth, image)
        picture[start:stop] = image.reshape(stop - start, SAMPLES, -1, SAMPLES, 3).mean(axis=(1, 3))

    run_parcels(fill_rows, len(picture), 48)
    return picture
