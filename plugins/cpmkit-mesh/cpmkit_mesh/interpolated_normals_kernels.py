"""Compiled: from the nearest point of a mesh to the point whose interpolated normal leads to the query.

On a triangle with corners a, b, c and unit normals there, p and n interpolate both linearly, and the closest point
solves p(v, w) + h n(v, w) = x for v, w and the height h. Both interpolants agree along shared edges: where a solution
lies outside its triangle, the search goes on across the edge that it violates. Past the boundary of the mesh the point
slides along the boundary, by the same equations one dimension lower. Arguments have no type annotations: numba infers
the types.
"""

from __future__ import annotations

import numpy as np

from cpmkit.plugin import compiled, inlined

BLOCKED_SLOT, FIRST_BOUNDARY_SLOT = -1, -2
#: Limits on the triangles that a search visits, and on its returns from the boundary.
MAX_TRIANGLES = 64
MAX_RETURNS = 3
#: A coordinate this little below zero is rounding; a point farther than so many distances is not the closest one.
COORDINATE_ROUNDING = 1e-12
FARTHEST_DISTANCES = 2.0


@compiled
def follow_normals(x, start, stop, tiny, mesh, rim, slot, local, point, distance, doubtful):
    """Move the nearest points of ``x[start:stop]`` (n, 3), in place, to points whose interpolated normals lead to x.

    ``mesh`` holds, by slot of the tree, corners and normals, each (m, 3, 3): the value at the first corner and the
    differences of the other two from it; and the neighbours' slots (m, 3). These and ``rim`` are as in
    ``InterpolatedNormals``. ``slot`` (n,), ``local`` (n, 2) and ``point`` (n, 3) are overwritten. ``distance`` (n,),
    that from the triangles, is only read. ``doubtful`` (n,) is written: True where no such point is found near by, so
    that the nearest point stays. Points of queries within ``tiny`` of the mesh stay as well, and are not doubtful.
    """
    frames, normals, neighbours = mesh
    for i in range(start, stop):
        doubtful[i] = False
        if distance[i] <= tiny:
            continue
        face, v, w, converged = _search_triangles(
            x[i], slot[i], local[i, 0], local[i, 1], frames, normals, neighbours, rim
        )
        square = 0.0
        for k in range(3):
            square += (x[i, k] - _linear_field(frames, face, v, w, k)) ** 2
        if converged and square <= (FARTHEST_DISTANCES * distance[i]) ** 2:
            slot[i], local[i, 0], local[i, 1] = face, v, w
            for k in range(3):
                point[i, k] = _linear_field(frames, face, v, w, k)
        else:
            doubtful[i] = True


@inlined
def _linear_field(frames, face, v, w, k):
    """Return coordinate ``k`` of a linear field on triangle ``face`` at its local coordinates v, w.

    ``frames`` (m, 3, 3) are the field's values at the first corner and the differences of the other two from it.
    """
    return frames[face, 0, k] + (v * frames[face, 1, k] + w * frames[face, 2, k])


@compiled
def _search_triangles(x, face, v, w, frames, normals, neighbours, rim):
    """Return the triangle of the closest point of ``x`` (3,), its coordinates v, w there, and whether it was found.

    The search starts on triangle ``face`` at v, w, and crosses an edge where a solution lies beyond it. Beyond the
    boundary it ends at the point of :func:`_closest_on_boundary`, which counts as found, whatever ended that search. It
    fails at an edge of three triangles or more, after :data:`MAX_TRIANGLES` triangles, or where a solution is not
    finite; v and w are 0 then. The arrays are those of :func:`follow_normals`.
    """
    height = _height(x, face, v, w, frames, normals)
    returns = 0
    for _ in range(MAX_TRIANGLES):
        v, w, height = _solve_on_triangle(x, face, v, w, height, frames, normals)
        u = 1.0 - v - w
        if not (np.isfinite(u) and np.isfinite(height)):
            return face, 0.0, 0.0, False
        edge, least = (0, u) if u <= v and u <= w else ((1, v) if v <= w else (2, w))
        if least >= -COORDINATE_ROUNDING:
            v, w = max(v, 0.0), max(w, 0.0)
            total = max(u, 0.0) + v + w
            return face, v / total, w / total, True
        across = neighbours[face, edge]
        if across == BLOCKED_SLOT:
            return face, 0.0, 0.0, False
        if across >= 0:
            face, v, w = across, 1.0 / 3.0, 1.0 / 3.0
            height = _height(x, face, v, w, frames, normals)
            continue
        k, s, inside = _closest_on_boundary(x, FIRST_BOUNDARY_SLOT - across, rim)
        face, edge = rim[4][k]
        v = 1.0 - s if edge == 0 else (s if edge == 2 else 0.0)
        w = s if edge == 0 else (1.0 - s if edge == 1 else 0.0)
        returns += 1
        if not inside or returns == MAX_RETURNS:
            return face, v, w, True
        height = _height(x, face, v, w, frames, normals)
    return face, 0.0, 0.0, False


@compiled
def _height(x, face, v, w, frames, normals):
    """Return the height h of ``x`` above the point p at v, w of triangle ``face``: (x - p) . n / n . n, normal n.

    ``frames`` and ``normals`` (m, 3, 3) are linear fields as in :func:`_linear_field`.
    """
    along, square = 0.0, 0.0
    for k in range(3):
        n = _linear_field(normals, face, v, w, k)
        along += (x[k] - _linear_field(frames, face, v, w, k)) * n
        square += n * n
    return along / square


@compiled
def _solve_on_triangle(x, face, v, w, h, frames, normals):
    """Return v, w, h with p(v, w) + h n(v, w) = ``x`` on triangle ``face``, by Newton's method from the given v, w, h.

    The point p and the normal n are the fields ``frames`` and ``normals``, as in :func:`_linear_field`. The method
    stops at a step of 1e-8 in v and w, after 12 steps, or where abs(v) + abs(w) > 8, converged or not; NaN or infinity
    is returned where the Jacobian is singular.
    """
    ax, ay, az = frames[face, 0, 0] - x[0], frames[face, 0, 1] - x[1], frames[face, 0, 2] - x[2]
    bx, by, bz = frames[face, 1, 0], frames[face, 1, 1], frames[face, 1, 2]
    cx, cy, cz = frames[face, 2, 0], frames[face, 2, 1], frames[face, 2, 2]
    nx, ny, nz = normals[face, 0, 0], normals[face, 0, 1], normals[face, 0, 2]
    mx, my, mz = normals[face, 1, 0], normals[face, 1, 1], normals[face, 1, 2]
    kx, ky, kz = normals[face, 2, 0], normals[face, 2, 1], normals[face, 2, 2]
    for _ in range(12):
        qx, qy, qz = nx + v * mx + w * kx, ny + v * my + w * ky, nz + v * mz + w * kz
        fx, fy, fz = ax + v * bx + w * cx + h * qx, ay + v * by + w * cy + h * qy, az + v * bz + w * cz + h * qz
        dx, dy, dz = bx + h * mx, by + h * my, bz + h * mz
        ex, ey, ez = cx + h * kx, cy + h * ky, cz + h * kz
        sx, sy, sz = ey * qz - ez * qy, ez * qx - ex * qz, ex * qy - ey * qx
        tx, ty, tz = qy * dz - qz * dy, qz * dx - qx * dz, qx * dy - qy * dx
        scale = 1.0 / (dx * sx + dy * sy + dz * sz)
        dv = -(fx * sx + fy * sy + fz * sz) * scale
        dw = -(fx * tx + fy * ty + fz * tz) * scale
        rx, ry, rz = dy * ez - dz * ey, dz * ex - dx * ez, dx * ey - dy * ex
        v, w, h = v + dv, w + dw, h - (fx * rx + fy * ry + fz * rz) * scale
        moved = abs(dv) + abs(dw)
        if not moved > 1e-8 or abs(v) + abs(w) > 8.0:
            break
    return v, w, h


@compiled
def _closest_on_boundary(x, k, rim):
    """Return the boundary edge, the share s of it in [0, 1], and whether ``x`` (3,) lies on the mesh's side there.

    The search starts on boundary edge ``k`` and passes on to the edges that touch it. At s the query lies in the plane
    of the normal and the conormal, both interpolated along the edge. At an end that no edge continues, and at a vertex
    from which both edges lead away from the query, s is 0.0 or 1.0 and the flag is False; after :data:`MAX_TRIANGLES`
    edges s is 0.5. ``rim`` are the arrays of :func:`follow_normals`.
    """
    links = rim[3]
    came = -1
    for _ in range(MAX_TRIANGLES):
        at_start, at_end = _offset_ahead(x, k, 0.0, rim), _offset_ahead(x, k, 1.0, rim)
        if at_start > 0.0 and at_end < 0.0:
            s = _root_on_edge(x, k, at_start, at_end, rim)
            return k, s, _offset_outward(x, k, s, rim) < 0.0
        end = 0 if at_start <= 0.0 else 1
        link = links[k, end]
        if link < 0 or end == came:
            return k, float(end), False
        k, came = link // 2, link % 2
    return k, 0.5, False


@compiled
def _offset_ahead(x, k, s, rim):
    """Return q . t - (q . n) (n . t) / (n . n), which is positive where ``x`` (3,) lies ahead of a boundary point.

    q leads to ``x`` from the point at the share ``s`` of boundary edge ``k``; n and t are the interpolated normal and
    tangent there. ``rim`` are the arrays of :func:`follow_normals`.
    """
    ends, normals, tangents = rim[0], rim[1], rim[2]
    xt, xn, nt, nn = 0.0, 0.0, 0.0, 0.0
    for j in range(3):
        q = x[j] - (ends[k, 0, j] + s * (ends[k, 1, j] - ends[k, 0, j]))
        n = normals[k, 0, j] + s * (normals[k, 1, j] - normals[k, 0, j])
        t = tangents[k, 0, j] + s * (tangents[k, 1, j] - tangents[k, 0, j])
        xt, xn, nt, nn = xt + q * t, xn + q * n, nt + n * t, nn + n * n
    return xt - xn * nt / nn


@compiled
def _root_on_edge(x, k, at_start, at_end, rim):
    """Return the root s in [0, 1] of :func:`_offset_ahead` on boundary edge ``k``, found by Illinois regula falsi.

    ``at_start`` > 0 and ``at_end`` < 0 are its values at s = 0 and 1, for the query ``x`` (3,). ``rim`` are the arrays
    of :func:`follow_normals`.
    """
    low, high, s = 0.0, 1.0, 0.5
    for _ in range(60):
        previous = s
        s = (low * at_end - high * at_start) / (at_end - at_start)
        value = _offset_ahead(x, k, s, rim)
        if value == 0.0 or abs(s - previous) <= 1e-15:
            break
        if value > 0.0:
            low, at_start = s, value
            at_end *= 0.5
        else:
            high, at_end = s, value
            at_start *= 0.5
    return min(max(s, 0.0), 1.0)


@compiled
def _offset_outward(x, k, s, rim):
    """Return q . (t x n), positive where ``x`` (3,) lies beyond the boundary; arguments as in :func:`_offset_ahead`."""
    q, n, t = np.empty(3), np.empty(3), np.empty(3)
    for j in range(3):
        q[j] = x[j] - (rim[0][k, 0, j] + s * (rim[0][k, 1, j] - rim[0][k, 0, j]))
        n[j] = rim[1][k, 0, j] + s * (rim[1][k, 1, j] - rim[1][k, 0, j])
        t[j] = rim[2][k, 0, j] + s * (rim[2][k, 1, j] - rim[2][k, 0, j])
    along = q[0] * (t[1] * n[2] - t[2] * n[1]) + q[1] * (t[2] * n[0] - t[0] * n[2])
    return along + q[2] * (t[0] * n[1] - t[1] * n[0])
