"""Colours of a solution baked to an image by a mesh's texture coordinates, for other programs to map onto it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import cpmkit as ck
from cpmkit.applications.colouring import ColouredSurface
from cpmkit.errors import InputError
from cpmkit.facade import Solution
from cpmkit.files.whole_files import write_png
from cpmkit.plugin import Mesh
from cpmkit.runtime.arrays import whole
from cpmkit.runtime.messages import warn_each
from cpmkit.types import Bools, Floats, Ints


class TexturedMesh(Mesh):
    """A mesh with texture coordinates at the corners of its triangles.

    Parameters
    ----------
    vertices, faces : (v, 3) float64 and (m, 3) int64
    coordinates : (k, 2) float64
        From 0 to 1, u to the right and v upwards.
    corners : (m, 3) int64
        Numbers of the texture coordinates of each triangle's corners.
    """

    coordinates: Floats
    corners: Ints

    def __init__(self, vertices: Floats, faces: Ints, coordinates: Floats, corners: Ints) -> None:
        self.__dict__.update(vars(Mesh.of(vertices, faces)), coordinates=coordinates, corners=corners)

    @property
    def faces(self) -> Ints:
        """(m, 3) the corners of each triangle."""
        return self.cells

    def __repr__(self) -> str:
        return f"TexturedMesh of {len(self.vertices):,} vertices and {len(self.faces):,} triangles"


@dataclass(frozen=True, eq=False)
class Texture:
    """An image to be mapped onto a mesh."""

    #: (height, width, 3): from 0 to 1, the top row (v = 1) first. Pixels outside of all triangles have the colour of
    #: the nearest pixel inside, so that seams are not visible.
    colours: Floats
    covered: Bools  #: (height, width): which pixels have their centre in a triangle.

    def __repr__(self) -> str:
        height, width = self.covered.shape
        return f"Texture of {width} x {height} pixels, {self.covered.mean():.0%} of them in triangles"

    def save(self, path: str | Path) -> Path:
        """Write the image as a PNG file with eight bits per channel, and return its path."""
        return write_png(path, self.colours)


def bake(
    solution: Solution | ColouredSurface,
    mesh: str | Path | TexturedMesh,
    *,
    width: int = 1024,
    height: int | None = None,
) -> Texture:
    """Return the texture of a mesh with the colours of a solution.

    Parameters
    ----------
    solution : Solution or ColouredSurface
        A solution of three channels, on the mesh or on the surface that the mesh approximates.
    mesh : path or TexturedMesh
        An OBJ file with texture coordinates, found as :func:`cpmkit.source` finds files.
    width, height : int
        Size in pixels, from 1 to 16,384; square if only the width is given.

    Returns
    -------
    Texture

    Raises
    ------
    InputError
        If the solution has other than three channels, the mesh cannot be read, is away from the surface or has no
        texture coordinates, they leave the image, or no pixel lies in a triangle.

    Warns
    -----
    CpmkitWarning
        If triangles overlap in the image, as mirrored halves may: a pixel shows the last of its triangles.
    """
    from scipy.ndimage import distance_transform_edt

    read: Any = getattr(solution, "solution", solution)
    if read.channels != 3:
        raise InputError(f"a texture is baked of three channels, red, green and blue, got {read.channels}.")
    width = whole(width, "width in pixels", 1, 16384)
    height = width if height is None else whole(height, "height in pixels", 1, 16384)
    if not isinstance(mesh, TexturedMesh):
        mesh = TexturedMesh(*ck.read_mesh(mesh), *ck.read_texture_coordinates(mesh))
    triangle, local, overlapping = _rasterise_triangles(_pixel_triangles(mesh, width, height), width, height)
    covered = triangle >= 0
    if not covered.any():
        raise InputError(f"no pixel of {width} by {height} lies in a triangle of the texture; use more pixels.")
    if overlapping:
        share = f"{overlapping} of {np.count_nonzero(covered)} pixels of the texture"
        warn_each([f"triangles overlap at {share}, as mirrored halves do; such a pixel shows the last triangle."])
    corners = mesh.vertices[mesh.faces[triangle[covered]]]
    colours = np.zeros((height * width, 3))
    colours[covered] = np.clip(solution.evaluate(np.einsum("nc,ncd->nd", local[covered], corners)), 0.0, 1.0)
    image, mask = colours.reshape(height, width, 3), covered.reshape(height, width)
    nearest = distance_transform_edt(~mask, return_distances=False, return_indices=True)
    return Texture(image[nearest[0], nearest[1]], mask)


def _pixel_triangles(mesh: TexturedMesh, width: int, height: int) -> Floats:
    """Return the triangles (m, 3, 2) in pixels of the image: columns, and lines downwards.

    Centres of pixels are at whole numbers. Raises InputError if texture coordinates are missing or leave the image.
    """
    outside = np.abs(mesh.coordinates - 0.5).max(initial=0.0) - 0.5
    if len(mesh.corners) != len(mesh.faces):
        raise InputError(f"a textured mesh has corners for each of {len(mesh.faces)} faces, got {len(mesh.corners)}.")
    if not outside <= 1e-6:
        raise InputError(
            f"texture coordinates must be from 0 to 1, and exceed that by {outside:.3g}; tiles and "
            "repeated images are not baked."
        )
    at = np.stack([mesh.coordinates[:, 0] * width, (1 - mesh.coordinates[:, 1]) * height], axis=1) - 0.5
    return np.asarray(at[mesh.corners])


def _rasterise_triangles(triangles: Floats, width: int, height: int) -> tuple[Ints, Floats, int]:
    """Return the triangle (n,) at each pixel or -1, its barycentric coordinates (n, 3), and the number of overlaps.

    ``triangles`` (m, 3, 2) are in pixels. Pixels are numbered line by line, n = width height; an overlap is a pixel
    that is inside of several triangles, not on a common edge.
    """
    shown, local = np.full(height * width, -1), np.zeros((height * width, 3))
    times = np.zeros(height * width, dtype=np.int64)
    limit = np.array([width, height]) - 1
    low = np.clip(np.ceil(triangles.min(axis=1)), 0, limit + 1).astype(np.int64)
    size = np.maximum(np.clip(np.floor(triangles.max(axis=1)), -1, limit).astype(np.int64) - low + 1, 0)
    count = size.prod(axis=1)
    parcel = (np.cumsum(count) - 1) // 2_000_000  # pixels of bounding boxes at once
    for number in np.unique(parcel[count > 0]):
        rows = np.flatnonzero(parcel == number)
        row, begin = np.repeat(rows, count[rows]), np.cumsum(count[rows]) - count[rows]
        line, column = np.divmod(np.arange(len(row)) - np.repeat(begin, count[rows]), np.maximum(size[row, 0], 1))
        column, line = low[row, 0] + column, low[row, 1] + line
        weight = _barycentric_coordinates(triangles[row], np.stack([column, line], axis=1))
        inside = (weight >= 0).all(axis=1)
        pixel = line[inside] * width + column[inside]
        shown[pixel], local[pixel] = row[inside], weight[inside]
        times += np.bincount(pixel[(weight[inside] > 1e-9).all(axis=1)], minlength=len(times))
    return shown, local, int(np.count_nonzero(times > 1))


def _barycentric_coordinates(triangles: Floats, points: Ints) -> Floats:
    """Return barycentric coordinates (n, 3) of points (n, 2) in triangles (n, 3, 2); -1 in triangles without area."""
    a, b, c = (triangles[:, k] for k in range(3))

    def twice_area(o: Floats, q: Floats, r: Floats) -> Floats:
        return np.asarray((q[:, 0] - o[:, 0]) * (r[:, 1] - o[:, 1]) - (q[:, 1] - o[:, 1]) * (r[:, 0] - o[:, 0]))

    whole_area = twice_area(a, b, c)
    p = points.astype(np.float64)
    parts = np.stack([twice_area(p, b, c), twice_area(a, p, c), twice_area(a, b, p)], axis=1)
    safe = np.where(whole_area == 0, 1.0, whole_area)
    return np.asarray(np.where(whole_area[:, None] == 0, -1.0, parts / safe[:, None]))
