"""Triangles of one sample have it without being cut: the very samples that cutting finds, in the order of the cells."""

import numpy as np
import pytest
from sample_shapes import octahedron

from cpmkit.mesh.cell_quadrature import _all_samples, _samples_single_first
from cpmkit.mesh.mesh import Mesh

SPHERE = octahedron(4)


@pytest.mark.parametrize("curved", [False, True])
@pytest.mark.parametrize("clipped", [False, True])
@pytest.mark.parametrize("single", [1e-7, 5e-3])
def test_samples_are_those_of_the_cut_triangles(curved, clipped, single):
    vertices, cells = SPHERE.vertices + [0.013, 0.021, 0.007], np.ascontiguousarray(SPHERE.cells)
    edges = Mesh.of(vertices, cells).edges
    midpoints = 1.01 * vertices[edges.ends].mean(axis=1)[edges.of_cells] if curved else np.empty((len(cells), 0, 3))
    spacing, count = 0.3, len(cells)
    limits = np.full(count, single)
    limits[::7] = 0.0
    arrays = vertices, cells, midpoints, spacing, np.full(count, clipped), limits
    found, wanted = _samples_single_first(*arrays), _all_samples(*arrays, False)
    for one, other in zip(found, wanted, strict=True):
        np.testing.assert_array_equal(one, other)
    assert (np.diff(found[3]) >= 0).all()
