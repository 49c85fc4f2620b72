"""Kernels that find on which side of a component of the skin a point lies, and the moments of upper faces of cells.

A piece is a segment or convex polygon of the skin in one lattice cell, and a component a connected set of pieces in one
cell. In a `Geometry` component c has the pieces ``order[piece_starts[c] : piece_starts[c + 1]]``. Piece p has the
``corners`` from ``starts[p]`` on, the integral ``normals[p]`` of its outward normal, and the mean ``middles[p]`` of its
corners.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np

from cpmkit.mesh.solid_moments import LEGENDRE, LEGENDRE_INTEGRALS, MOMENTS, evaluate
from cpmkit.runtime.compilation import compiled
from cpmkit.types import Bools, Floats, Ints

#: order, piece_starts, corners, starts, normals, middles
Geometry: TypeAlias = tuple[Ints, Ints, Floats, Ints, Floats, Floats]

#: A point within this distance of a face, in spacings, lies in it.
IN_FACE = 1e-7
#: A point within this distance of a piece, in spacings, lies on it.
ON_PIECE = 1e-9
#: Crossings of a segment nearer to each other than this share of it are at one point, of two pieces on a boundary
#: inside.
SAME_CROSSING = 1e-9
#: Components are tested at this distance, in spacings, on their inner side, since another component may lie upon them.
INSIDE_PIECE = 3e-9
#: If the volume of an inner side is nearer than this to zero or to that of the cell, the centre of the cell decides.
DOUBTFUL_VOLUME = 1e-5
GAUSS, GAUSS_WEIGHTS = (0.5 * part for part in np.polynomial.legendre.leggauss(MOMENTS))


@compiled
def contains(piece: int, x: Floats, geometry: Geometry) -> bool:
    """Return whether ``piece`` contains a point ``x`` (d,) of its plane or line."""
    _, _, corners, starts, normals, _ = geometry
    d, first, last = len(x), starts[piece], starts[piece + 1]
    for k in range(first, last):
        following = k + 1 if k + 1 < last else first
        if d == 2:
            along = 0.0
            for i in range(2):
                along += (corners[following, i] - corners[k, i]) * (x[i] - corners[k, i])
            if along < 0:
                return False
            continue
        a0, b0 = corners[following, 0] - corners[k, 0], x[0] - corners[k, 0]  # arrays would be allocated each time
        a1, b1 = corners[following, 1] - corners[k, 1], x[1] - corners[k, 1]
        a2, b2 = corners[following, 2] - corners[k, 2], x[2] - corners[k, 2]
        across = normals[piece, 0] * (a1 * b2 - a2 * b1) + normals[piece, 1] * (a2 * b0 - a0 * b2)
        if across + normals[piece, 2] * (a0 * b1 - a1 * b0) < 0:
            return False
    return True


@compiled
def is_inside(point: Floats, c: int, geometry: Geometry) -> bool:
    """Return whether ``point`` (d,) lies on the inner side of component ``c``.

    The first piece on a segment from the point to the component decides; the segment leads to the centre of the piece
    that faces the point most directly. Points on the component count as inside. Of two pieces at one place, the one
    that has the point on its inner side counts.
    """
    order, piece_starts, _, _, normals, middles = geometry
    d = len(point)
    best, target = -1.0, -1
    for k in range(piece_starts[c], piece_starts[c + 1]):
        p = order[k]
        square, across, size = 0.0, 0.0, 0.0
        for i in range(d):
            step = middles[p, i] - point[i]
            square += step * step
            across += normals[p, i] * step
            size += normals[p, i] ** 2
        seen = abs(across) / (np.sqrt(size) * max(square, 1e-300))
        if seen > best:
            best, target = seen, p
    way, x = np.empty(d), np.empty(d)
    share, outward = 1.0, 0.0
    for i in range(d):
        way[i] = middles[target, i] - point[i]
        outward += normals[target, i] * way[i]
    for k in range(piece_starts[c], piece_starts[c + 1]):
        p = order[k]
        along, offset, size = 0.0, 0.0, 0.0
        for i in range(d):
            along += normals[p, i] * way[i]
            offset += normals[p, i] * (middles[p, i] - point[i])
            size += normals[p, i] ** 2
        if offset**2 <= ON_PIECE**2 * size and contains(p, point, geometry):
            return True
        if p == target or along == 0:
            continue
        t = offset / along
        if t < 0 or t > share + SAME_CROSSING:
            continue
        for i in range(d):
            x[i] = point[i] + t * way[i]
        if contains(p, x, geometry):
            outward = along if t < share - SAME_CROSSING else max(along, outward)
            share = min(t, share)
    return outward > 0


@compiled
def group_components(
    component_starts: Ints, part: Ints, is_inner: Bools, side_starts: Ints, geometry: Geometry
) -> Ints:
    """Fill ``part`` (k,) with the number, within its cell, of the part of the solid that each component bounds.

    Returned are the numbers of parts (c,) of the cells. The components of cell r are ``component_starts[r]`` to
    ``component_starts[r + 1]`` - 1. ``is_inner`` is filled from ``side_starts[r]`` on, for cells with n > 1 components:
    entry n i + j is whether component j is on the inner side of component i.
    """
    order, piece_starts, _, _, normals, middles = geometry
    cells = len(component_starts) - 1
    parts, at = np.empty(cells, dtype=np.int64), np.empty(normals.shape[1])
    parts[:] = 1
    for r in range(cells):
        first, n = component_starts[r], component_starts[r + 1] - component_starts[r]
        if n < 2:
            continue
        inner = is_inner[side_starts[r] : side_starts[r + 1]]
        for i in range(n):
            for j in range(n):
                p = order[piece_starts[first + j]]
                square = 0.0
                for axis in range(len(at)):
                    square += normals[p, axis] ** 2
                for axis in range(len(at)):
                    at[axis] = middles[p, axis] - INSIDE_PIECE / np.sqrt(square) * normals[p, axis]
                inner[n * i + j] = i == j or is_inside(at, first + i, geometry)
        parts[r] = 0
        for j in range(n):
            part[first + j] = -1
            for i in range(j):
                joined = inner[n * i + j] and inner[n * j + i]
                for k in range(n):
                    if k not in (i, j) and inner[n * k + i] != inner[n * k + j]:
                        joined = False
                if joined and part[first + j] < 0:
                    part[first + j] = part[first + i]
            if part[first + j] < 0:
                part[first + j] = parts[r]
                parts[r] += 1
    return parts


@compiled
def parts_at(
    rows: Ints,
    points: Floats,
    component_starts: Ints,
    part: Ints,
    is_inner: Bools,
    side_starts: Ints,
    geometry: Geometry,
) -> Ints:
    """Return the number (n,) of the part that contains each of ``points`` (n, d) in cells ``rows`` (n,), -1 for none.

    The cells have several components; other arguments are those of :func:`group_components`.
    """
    found = np.full(len(rows), -1)
    for q in range(len(rows)):
        r = rows[q]
        first, n = component_starts[r], component_starts[r + 1] - component_starts[r]
        inner = is_inner[side_starts[r] : side_starts[r + 1]]
        sides = np.empty(n, dtype=np.bool_)
        for i in range(n):
            sides[i] = is_inside(points[q], first + i, geometry)
        for j in range(n):
            fits = sides[j]
            for i in range(n):
                if part[first + i] == part[first + j]:
                    fits = fits and sides[i]
                elif sides[i] != inner[n * i + j]:
                    fits = False
            if fits:
                found[q] = part[first + j]
    return found


@compiled
def add_upper_faces(components: Ints, cells: Ints, moments: Floats, geometry: Geometry) -> None:
    """Add to ``moments`` (n, 5, 5^(d-1)) those of the upper faces of ``cells`` (n, d) on inner sides of ``components``.

    ``components`` (n,) are numbers; ``moments`` already have the integrals over them. The divergence theorem is applied
    along axis 1 in the face, which a component meets in segments, and along axis 2 in the upper edge of the face, which
    it meets in points. The upper corner is on the inner side of the component or not; without that term the volume
    might be negative.
    """
    order, piece_starts, corners, starts, normals, _ = geometry
    d = cells.shape[1]
    depth = MOMENTS if d == 3 else 1
    first, second = np.empty(MOMENTS), np.empty(MOMENTS)
    edge, middle = np.empty(MOMENTS), np.empty(d)
    for row in range(len(components)):
        c, cell = components[row], cells[row]
        edge[:] = 0.0
        for k in range(piece_starts[c], piece_starts[c + 1]):
            p = order[k]
            size = 0.0
            for i in range(d):
                size += abs(normals[p, i])
            for at in range(starts[p], starts[p + 1]):
                following = at + 1 if at + 1 < starts[p + 1] else starts[p]
                if abs(corners[at, 0] - cell[0] - 0.5) > IN_FACE:
                    continue
                if d == 2:
                    sign = np.sign(normals[p, 1]) if abs(normals[p, 1]) > 1e-12 * size else 0.0
                    evaluate(LEGENDRE_INTEGRALS, corners[at, 1] - cell[1] + 0.5, first)
                    for i in range(MOMENTS):
                        edge[i] += sign * first[i]
                    continue
                if abs(corners[following, 0] - cell[0] - 0.5) > IN_FACE:
                    continue
                length = np.sign(normals[p, 1]) * abs(corners[following, 2] - corners[at, 2])
                for g in range(MOMENTS):
                    s = GAUSS[g] + 0.5
                    x = (1 - s) * corners[at, 1] + s * corners[following, 1]
                    y = (1 - s) * corners[at, 2] + s * corners[following, 2]
                    evaluate(LEGENDRE_INTEGRALS, x - cell[1] + 0.5, first)
                    evaluate(LEGENDRE, y - cell[2] + 0.5, second)
                    for i in range(MOMENTS):
                        for j in range(MOMENTS):
                            moments[row, 0, MOMENTS * i + j] += length * GAUSS_WEIGHTS[g] * first[i] * second[j]
                along = max(abs(corners[at, 1] - cell[1] - 0.5), abs(corners[following, 1] - cell[1] - 0.5)) <= IN_FACE
                if along:  # in the upper edge: as if before it, so that it is not left where the segment ends
                    for end, other in ((at, following), (following, at)):
                        if abs(corners[end, 2] - cell[2] - 0.5) > IN_FACE:
                            evaluate(LEGENDRE_INTEGRALS, corners[end, 2] - cell[2] + 0.5, second)
                            sign = np.sign(normals[p, 1]) * np.sign(corners[end, 2] - corners[other, 2])
                            for i in range(MOMENTS):
                                edge[i] -= sign * second[i]
                if along or abs(normals[p, 2]) <= 1e-12 * size:
                    continue
                for end in (at, following):
                    if abs(corners[end, 1] - cell[1] - 0.5) <= IN_FACE:
                        evaluate(LEGENDRE_INTEGRALS, corners[end, 2] - cell[2] + 0.5, second)
                        for i in range(MOMENTS):
                            edge[i] += np.sign(normals[p, 2]) * second[i]
        for j in range(MOMENTS if d == 2 else depth):
            moments[row, 0, j] += edge[j]
        volume = moments[row, 0, 0]
        for i in range(d):
            middle[i] = cell[i]
        if volume < -DOUBTFUL_VOLUME or (volume < DOUBTFUL_VOLUME and is_inside(middle, c, geometry)):
            moments[row, 0, 0] += 1.0
