"""One ghost goes from its closest point to its row of A through at most 9 files of the collocation form.

The trip is measured, not listed: from where the ghosts of a boundary are found among the band's nodes (their closest
points on it are asked for) to E, N, the data and A, which keeps these tables; `operator` runs where A is applied.
Beneath it lie the rooms that know no ghost; beside it what is made once a scene, the boundary with its sides
(`put_on_lattice`) and the band, and what is asked of the layout for warnings.
"""

import sys
from pathlib import Path

import numpy as np
import pytest

import cpmkit as ck
from cpmkit.forms.collocation import band_layout, discretization
from cpmkit.forms.collocation.extension_operator import build_operator
from cpmkit.forms.collocation.ghosts.ghosts import ghost_formula

CORE = Path(ck.__file__).parent
#: The stations of the method, in the order in which a ghost passes them, for one sheet, no edge and order 2.
STATIONS = [
    "ghosts/ghosts",  # which nodes have a ghost, and the formula of the condition
    "side_view",  # their distances and sides
    "ghosts/ghost_geometry",  # the way across, the mirror point, where right-hand sides are read
    "row_formula",  # points, coefficients, data
    "band_layout",  # E
    "selection",  # which unknowns its stencils read
    "discretization",  # N
    "extension_operator",  # A
]
#: What lies beneath: the lattice and its stencils, what makes sparse matrices of rows, the manifold.
BENEATH = [
    "grid/band",
    "grid/lattice",
    "linear/operators",
    "manifold/local_source",
    "manifold/source",
    "manifold/tangent_space",
    "manifold/vector_algebra",
]


@pytest.fixture
def watched(monkeypatch):
    """The files of the core, without ending, whose functions ran while functions that are watched did."""
    files = set()

    def note(frame, event, _):
        path = Path(frame.f_code.co_filename)
        if event == "call" and path.is_relative_to(CORE):
            files.add(path.relative_to(CORE).with_suffix("").as_posix())

    def watch(function):
        def noted(*arguments, **options):
            before = sys.getprofile()
            sys.setprofile(note)
            try:
                return function(*arguments, **options)
            finally:
                sys.setprofile(before)

        return noted

    monkeypatch.setattr(band_layout, "build_ghosts", watch(band_layout.build_ghosts))
    monkeypatch.setattr(discretization, "tables_of_layout", watch(discretization.tables_of_layout))
    return files, watch


def one_boundary():
    equator = ck.source("analytic.circle", normal=[0, 0, 1])
    cut = ck.Boundary("equator", equator, left=ck.Dirichlet(1.0), right=ck.Robin(1.0, 2.0, 0.5))
    return ck.Scene(ck.source("analytic.sphere"), ck.ScreenedPoisson(1.0, c=1.0), [cut])


def test_a_ghost_passes_through_eight_files(watched):
    files, watch = watched
    scene = one_boundary()
    tables = ck.discretize(scene, 0.2, form="collocation").tables
    watch(build_operator)(tables, scene.problem.terms())
    watch(tables.datum)()
    room = "forms/collocation/"
    assert {file.removeprefix(room) for file in files if file.startswith(room)} == set(STATIONS)
    assert len(STATIONS) <= 9
    assert {file for file in files if file.split("/")[0] in ("grid", "manifold", "linear")} == set(BENEATH)


def test_formulas_of_other_orders_ask_for_no_point_a_second_time():
    """Ghosts keep their geometry: what they read at the first or the second order follows from it."""
    tables = ck.discretize(one_boundary(), 0.2, form="collocation").tables
    (ghosts,), target = tables.layout.ghosts, tables.layout.queries
    (again, *_), (first, _, _, orders, _) = (ghost_formula(ghosts.geometry, order) for order in (2, 1))
    assert tables.layout.queries == target
    np.testing.assert_array_equal(again.points, ghosts.formula.points)
    np.testing.assert_array_equal(first.points, ghosts.geometry.seen.foot)
    assert (orders == 1).all()
