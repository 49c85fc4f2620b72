"""Triangles at an edge are paired around it, and those that cross at a vertex are found."""

import numpy as np
import pytest

from cpmkit.mesh.mesh import Mesh
from cpmkit.mesh.sectors import crossed_vertices


def pages(order):
    """Return three pages along two edges in a line, with their corners in another ``order`` at the second edge."""
    angle = 2 * np.pi * np.arange(3) / 3
    ring = np.stack([0 * angle, np.cos(angle), np.sin(angle)], axis=1)
    vertices = np.concatenate([[[0, 0, 0], [1, 0, 0], [2, 0, 0]], ring + [0.5, 0, 0], ring[order] + [1.5, 0, 0]])
    cells = [[(0, 1, 3 + k), (1, 2, 6 + k), (1, 6 + k, 3 + k)] for k in range(3)]
    return Mesh.of(vertices.astype(float), np.array(cells).reshape(-1, 3))


@pytest.mark.parametrize(("order", "crossed"), [([0, 1, 2], []), ([1, 2, 0], []), ([0, 2, 1], [1])])
def test_pages_that_change_their_order_cross(order, crossed):
    """A turn of all pages, as a screw has, is none."""
    assert crossed_vertices(pages(order)).tolist() == crossed
