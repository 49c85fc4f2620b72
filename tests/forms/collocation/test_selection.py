"""What stencils read is chosen by one function, which writes to nothing and asks for no closest point a second time."""

from types import SimpleNamespace

import numpy as np
import pytest
from layouts import build_layout

import cpmkit as ck
from cpmkit.forms.collocation.discretization import tables_of_layout
from cpmkit.forms.collocation.selection import Centres, Unknowns
from cpmkit.grid.band import stencil_cells, stencil_nodes


def cut_spiral(**conditions):
    """A curve whose turns lie two spacings apart, with a cut in the middle turn."""
    curve = ck.source("parametric.curve", x=["(1 + 0.03*t)*cos(t)", "(1 + 0.03*t)*sin(t)"], range=[0, 16])
    cut = ck.source("analytic.point", at=[1.24 * np.cos(8), 1.24 * np.sin(8)])
    return ck.Scene(curve, ck.ScreenedPoisson(1.0, c=1.0), [ck.Boundary("cut", cut, **conditions)])


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize(
    "conditions", [{"both": ck.Dirichlet(1.0)}, {"both": ck.Neumann(0.0)}, {"across": ck.Transmission()}]
)
def test_rows_know_their_feet_and_normals(conditions, order):
    layout = build_layout(cut_spiral(**conditions), 0.1, order=order)
    assert layout.band.inner > layout.band.first_twin + 100
    target = layout.queries
    tables = tables_of_layout(layout)
    assert layout.queries == target
    ones = tables.extension @ np.ones(tables.unknowns.count)
    np.testing.assert_allclose(ones[: layout.band.own_inner], 1.0, atol=1e-12)


def test_stencils_are_not_written_to_and_read_twins_and_ghosts():
    layout = build_layout(cut_spiral(both=ck.Dirichlet(1.0)), 0.1)
    band, nodes = layout.band, np.arange(layout.band.inner)
    (view,) = layout.boundaries.side_views
    inner = view.take(view.rows < band.inner)
    columns = stencil_nodes(band, stencil_cells(band.feet.points[nodes], band.spacing, band.degree)[0])
    columns.flags.writeable = False
    read = layout.unknowns.select(Centres.of_points(band.feet.take(nodes), [inner]), columns)
    changed = read != columns
    assert (read[changed] >= band.first_twin).all()
    assert np.count_nonzero(read[changed] < band.inner) > 100  # twins
    assert np.count_nonzero(read >= band.inner) > 10  # ghosts


def test_rows_and_unknowns_are_distinguished():
    ghosts = [SimpleNamespace(nodes=range(count), unknowns=unknowns) for count, unknowns in ((4, 2), (0, 0), (2, 1))]
    unknowns = Unknowns(SimpleNamespace(nodes=range(5), inner=3), ghosts)
    assert (unknowns.rows, unknowns.count) == (11, 6)
    np.testing.assert_array_equal(unknowns.row_of_unknown, [0, 1, 2, 5, 6, 9])
    np.testing.assert_array_equal(unknowns.unknown_of_row, [0, 1, 2, -1, -1, 3, 4, -1, -1, 5, -1])
    assert [unknowns.rows_of(k) for k in range(3)] == [slice(5, 9), slice(9, 9), slice(9, 11)]
    assert [unknowns.unknowns_of(k) for k in range(3)] == [slice(3, 5), slice(5, 5), slice(5, 6)]
