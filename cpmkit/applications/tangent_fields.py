"""What is told of a field of tangential vectors: its singularities, by index and place."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.plugin import vertex_normals
from cpmkit.protocols import Floats, Ints


@dataclass(frozen=True)
class Singularity:
    """A point that a field turns round.

    Attributes
    ----------
    place : (3,) float64
        The centre of the triangle that it lies in.
    index : int
        How often the field turns round while one goes round the point once, the same way where positive. On a surface
        that is not orientable the sign is the triangle's own.
    """

    place: Floats
    index: int


def singularities(vertices: Floats, faces: Ints, vectors: Floats, normals: Floats | None = None) -> list[Singularity]:
    """Return the singularities of a field given by tangential ``vectors`` (v, 3) at the vertices of a mesh.

    ``normals`` (v, 3) are those of the triangles unless given, and on a surface that is not orientable.

    In each triangle the field is turned from corner to corner by the smallest rotation that takes one corner's plane to
    the next one's; its index is what remains of the turns, with the curvature of the triangle, over 2 pi. On a closed
    surface the indices sum to the Euler characteristic of the mesh, exactly, whatever the field; also where the mesh is
    cut along a curve that the field runs along on both sides, one way or opposite ways, with the same ``normals``.
    """
    corners = vertices[faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    if _turned_one_way(faces):  # a sliver that faces its own corners' normals is no other side of the surface
        normals = vertex_normals(vertices, faces) if normals is None else normals
        signs = np.ones(faces.shape)
    else:
        normals = _normals_of_any_sign(len(vertices), faces, across)
        signs = np.where(np.einsum("fd,fcd->fc", across, normals[faces]) < 0, -1.0, 1.0)
    planes = normals[faces] * signs[:, :, None]  # (f, 3, 3): the corners' normals, to the triangle's own side
    first = _perpendicular(planes)
    second = np.cross(planes, first)
    given = vectors[faces]
    angle = np.arctan2(np.einsum("fcd,fcd->fc", given, second), np.einsum("fcd,fcd->fc", given, first))
    turned = np.stack([_transport(planes, first, second, k) for k in range(3)], axis=1)
    steps = _wrapped(np.roll(angle, -1, axis=1) - angle - turned)
    curvature = _wrapped(turned.sum(axis=1))
    index = np.rint((steps.sum(axis=1) + curvature) / (2 * np.pi)).astype(int)
    found = np.flatnonzero(index)
    return [Singularity(corners[one].mean(axis=0), int(index[one])) for one in found]


def _turned_one_way(faces: Ints) -> bool:
    """Tell whether neighbouring triangles run opposite ways along their edge, all over the mesh."""
    edges = np.concatenate([faces[:, [k, (k + 1) % 3]] for k in range(3)])
    return len(np.unique(edges, axis=0)) == len(edges)


def _normals_of_any_sign(count: int, faces: Ints, across: Floats) -> Floats:
    """Return unit normals (count, 3) at vertices to which no sign of the triangles' own ``across`` (f, 3) matters."""
    squares = np.zeros((count, 3, 3))
    area = np.linalg.norm(across, axis=1)[:, None, None]
    np.add.at(squares, faces.ravel(), np.repeat(across[:, :, None] * across[:, None] / (area + (area == 0)), 3, axis=0))
    return np.asarray(np.linalg.eigh(squares)[1][:, :, -1])


def _perpendicular(normals: Floats) -> Floats:
    """Return unit vectors (f, 3, 3) perpendicular to ``normals``, the same for equal normals up to their sign."""
    axis = np.eye(3)[np.abs(normals).argmin(axis=2)]
    found = np.cross(normals, axis)
    return np.asarray(found / np.linalg.norm(found, axis=2, keepdims=True))


def _transport(planes: Floats, first: Floats, second: Floats, corner: int) -> Floats:
    """Return the angle (f,) at which the first axis of a corner's plane arrives in that of the next."""
    after = (corner + 1) % 3
    n, m, axis = planes[:, corner], planes[:, after], first[:, corner]
    cosine = np.einsum("fd,fd->f", n, m)[:, None]
    turn = np.cross(n, m)
    # Rodrigues' rotation that takes n to m
    moved = axis * cosine + np.cross(turn, axis) + turn * np.einsum("fd,fd->f", turn, axis)[:, None] / (1 + cosine)
    along, across = (np.einsum("fd,fd->f", moved, one[:, after]) for one in (first, second))
    return np.asarray(np.arctan2(across, along))


def _wrapped(angles: Floats) -> Floats:
    """Return angles between -pi and pi."""
    return np.asarray((angles + np.pi) % (2 * np.pi) - np.pi)
