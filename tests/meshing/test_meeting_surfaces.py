"""Points where the edges of one surface meet another one."""

import numpy as np
import pytest

from cpmkit.mesh.mesh import Mesh
from cpmkit.meshing.meeting_surfaces import piercing_points
from cpmkit.meshing.quadratic_surface import QuadraticSurface


def square(side, low=-1.0):
    """Return a square in the plane z = 0, or across it in the plane y = 0 from z = ``low`` on."""
    corners = np.array([[-side, low, 0], [side, low, 0], [side, side, 0], [-side, side, 0]], dtype=float)
    vertices = corners if low == -side else corners[:, [0, 2, 1]]
    cells = np.array([[0, 1, 2], [0, 2, 3]])
    middles = vertices[cells]
    return Mesh.of(vertices, cells, 0.5 * (middles.sum(axis=1, keepdims=True) - middles))


@pytest.mark.parametrize(("low", "points"), [(-0.3, [-0.5, 0.5]), (-0.01, [])])
def test_rims_pierce_a_surface_unless_they_end_on_it(low, points):
    surface = QuadraticSurface(square(2.0, -2.0))
    found = piercing_points(square(0.5, low), lambda x: surface.side(x, 1.0), 0.02)
    assert sorted(found[:, 0].round(9)) == points
    assert np.abs(found[:, 1:]).max(initial=0.0) < 1e-12
