"""Cells are oriented by walking over the facets that two of them share; on one-sided pieces that breaks somewhere."""

import numpy as np
from sample_shapes import moebius, octahedron

from cpmkit.plugin import Mesh


def test_cells_that_were_turned_are_marked():
    sphere, rng = octahedron(3), np.random.default_rng(3)
    turned = rng.uniform(size=len(sphere.cells)) < 0.4
    cells = np.where(turned[:, None], sphere.cells[:, ::-1], sphere.cells)
    found = Mesh.of(sphere.vertices, cells).winding
    assert len(np.unique(found * np.where(turned, -1, 1))) == 1
    assert abs(int(found[0])) == 1


def test_segments_that_were_turned_are_marked():
    number = np.arange(20)
    cells = np.stack([number, np.roll(number, -1)], axis=1)
    turned = number % 3 == 0
    cells[turned] = cells[turned, ::-1]
    found = Mesh.of(np.zeros((20, 2)), cells).winding
    assert len(np.unique(found * np.where(turned, -1, 1))) == 1
    assert abs(int(found[0])) == 1


def test_a_one_sided_band_breaks_at_few_cells():
    band, _ = moebius()
    found = band.winding
    assert 0 < np.count_nonzero(found == 0) < 0.2 * len(found)
