"""The compiled loop that fills the pixels of triangles."""

from __future__ import annotations

import numpy as np

from cpmkit.protocols import Floats, Ints
from cpmkit.runtime.compilation import compiled


@compiled
def fill(
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
    """Draw triangles over what rows of an image show, where they are nearer.

    Parameters
    ----------
    corners : (v, 3) float64
        Columns and rows from the upper left corner, in pixels, and how near to the viewer.
    triangles : (t, 3) int64
    paint : (v, 3) or (v, 1) float64
        Colours of the vertices, or their places from 0 to 1 in ``table`` (k, 3).
    normals : (v, 3) float64
        To the right, up and towards the viewer; no rows where no light falls.
    signs : (t, 3) float64
        1 or -1 at each corner of a triangle: what turns its normal to the side of the triangle that is seen.
    light : (3,) float64
        Unit vector towards the light.
    ambient : float
        Share of its colour that a face keeps where no light falls.
    first_row : int
        That of ``depth`` (rows, columns) and ``image`` (rows, columns, 3) in the whole picture.
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
                near = u * corners[i, 2] + v * corners[j, 2] + w * corners[k, 2]
                if near <= depth[row, column]:
                    continue
                depth[row, column] = near
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
