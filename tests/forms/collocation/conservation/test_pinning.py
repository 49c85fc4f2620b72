"""The pieces of the manifold on which nothing fixes the solution are found, and no others."""

import numpy as np
import pytest

import cpmkit as ck

FREE, FIXED = ck.Neumann(0.0), ck.Dirichlet(1.0)
TILTED = np.array([0.3, 0.2, 1.0]) / np.linalg.norm([0.3, 0.2, 1.0])


def circle(name, height, normal=(0, 0, 1), **sides):
    axis = np.asarray(normal) / np.linalg.norm(normal)
    source = ck.source("analytic.circle", center=height * axis, radius=(1 - height**2) ** 0.5, normal=axis)
    return ck.Boundary(name, source, **sides)


def scene(*boundaries, surface=None, problem=None, **options):
    return ck.Scene(surface or ck.source("analytic.sphere"), problem or ck.Poisson(0.0), boundaries, **options)


def free_pieces(spacing, *boundaries, **options):
    return ck.solve(scene(*boundaries, **options), spacing, form="collocation", solver="reference").imbalances


def test_a_closed_surface_without_conditions():
    (piece,) = free_pieces(0.2)
    assert piece.share == 1.0
    assert piece.bounded_by == ()
    assert np.linalg.norm(piece.near) == pytest.approx(1.0)


def test_the_neumann_side_of_a_curve():
    # Its normal points up, so its left is inside: the head over your left hand is the pole.
    (piece,) = free_pieces(0.2, circle("wall", 0.5, left=FREE, right=FIXED))
    assert piece.bounded_by == ("'wall' (left)",)
    assert piece.near[2] > 0.5
    assert 0.15 < piece.share < 0.35


def test_both_sides_of_a_wall():
    pieces = free_pieces(0.2, circle("wall", 0.2, both=FREE))
    assert sorted(piece.bounded_by for piece in pieces) == [("'wall' (left)",), ("'wall' (right)",)]
    assert sum(piece.share for piece in pieces) == pytest.approx(1.0)


def test_a_strip_between_two_walls_is_free_and_the_caps_beside_it_are_not():
    (piece,) = free_pieces(
        0.1, circle("low", -0.4, left=FREE, right=FIXED), circle("high", 0.4, left=FIXED, right=FREE)
    )
    assert piece.bounded_by == ("'low' (left)", "'high' (right)")
    assert abs(piece.near[2]) < 0.4


def test_parts_that_meet_where_walls_cross_count_as_one():
    one, axis = circle("one", 0.0, TILTED, both=FREE), (1, 0.1, -0.2)
    solution = ck.solve(scene(one, circle("other", 0.1, axis, both=FREE)), 0.2, form="collocation")
    (piece,) = solution.imbalances
    assert piece.share == 1.0
    assert not free_pieces(0.2, one, circle("other", 0.1, axis, left=FREE, right=ck.Robin(1.0, 1.0, 0.0)))


def test_a_strip_narrower_than_a_spacing_is_a_piece():
    walls = scene(circle("low", 0.2, TILTED, both=FREE), circle("high", 0.27, TILTED, both=FREE))
    assert ck.assemble(ck.discretize(walls, 0.1, form="collocation")).operator.pieces()[0] == 3


def test_ghosts_belong_to_the_piece_that_they_carry():
    cut = scene(circle("wall", 0.2, TILTED, both=FREE))
    form = ck.discretize(cut, 0.15, form="collocation")
    tables, (count, label) = form.tables, ck.assemble(form).operator.pieces()
    inner, (ghosts,) = tables.layout.band.inner, tables.layout.ghosts
    up = tables.layout.band.feet.points @ TILTED > 0.2
    assert count == 2
    (above,), (below,) = np.unique(label[:inner][up[:inner]]), np.unique(label[:inner][~up[:inner]])
    assert np.array_equal(label[inner:], np.where(up[ghosts.nodes[: ghosts.unknowns]], below, above))


def test_transmission_joins_its_two_sides():
    (piece,) = free_pieces(0.2, circle("contact", 0.2, TILTED, across=ck.Transmission(jump=2.0)))
    assert piece.share == 1.0
    cut = circle("contact", 0.2, TILTED, across=ck.Transmission(jump=2.0))
    assert not free_pieces(0.2, cut, circle("wall", 0.7, TILTED, both=FIXED))


def test_dirichlet_data_anywhere_on_the_piece_pin_it():
    pin = ck.Boundary("pin", ck.source("analytic.point", at=[0, 0, 1.0]), both=FIXED)
    solution = ck.solve(scene(circle("wall", 0.5, left=FREE, right=FIXED), pin), 0.2, form="collocation")
    assert not solution.imbalances
    assert solution.evaluate([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]) == pytest.approx([1.0, 1.0], abs=1e-8)


def test_an_open_curve_cuts_nothing_off():
    arc = ck.source("analytic.arc", center=[0, 0, 0], radius=1.0, start=0.2, end=2.0, normal=[0.3, 0.5, 0.8])
    half = ck.Boundary("arc", arc, left=FREE, right=FIXED)
    solution = ck.solve(scene(half), 0.2, form="collocation")
    assert not solution.imbalances
    assert solution.evaluate([[0, 0, -1.0]]) == pytest.approx([1.0], abs=1e-8)
    (piece,) = free_pieces(0.2, ck.Boundary("arc", arc, both=FREE))
    assert piece.share == 1.0


def test_a_dirichlet_edge_pins_and_a_neumann_edge_does_not():
    cap = ck.source("analytic.cap", height=0.1)
    assert len(free_pieces(0.2, surface=cap)) == 1
    solution = ck.solve(scene(surface=cap, edge=FIXED), 0.2, form="collocation")
    assert not solution.imbalances
    assert solution.evaluate([[0, 0, 1.0]]) == pytest.approx([1.0], abs=1e-8)


def test_pieces_that_do_not_touch_have_each_their_own_constant():
    apart = ck.source("union", members=[ck.source("analytic.circle"), ck.source("analytic.circle", center=[3, 0])])
    pieces = free_pieces(0.1, surface=apart)
    assert sorted(round(piece.near[0] / 3) for piece in pieces) == [0, 1]
    pin = ck.Boundary("pin", ck.source("analytic.point", at=[4, 0]), both=FIXED)
    (piece,) = free_pieces(0.1, pin, surface=apart)
    assert piece.near[0] < 1.5


@pytest.mark.parametrize(
    "problem",
    [ck.ScreenedPoisson(2.0, c=4.0), ck.Helmholtz(2.0, wavenumber=0.5), ck.Elliptic(2.0, c=lambda x: 4 + 0 * x[:, 0])],
    ids=["screened", "Helmholtz", "a callable c"],
)
def test_a_factor_of_u_pins_everything(problem):
    solution = ck.solve(scene(problem=problem), 0.2, form="collocation")
    assert not solution.imbalances
    c = -0.25 if problem.kind == "helmholtz" else 4.0
    assert solution.evaluate([[0, 0, 1.0]]) == pytest.approx([2.0 / c], abs=1e-8)


@pytest.mark.parametrize("form", ["collocation", "galerkin"])
def test_two_point_values_on_a_surface_are_warned_of(form):
    def pins(*positions):
        return [
            ck.Boundary(f"pin {k}", ck.source("analytic.point", at=at), both=ck.Dirichlet(float(k)))
            for k, at in enumerate(positions)
        ]

    assert not ck.solve(scene(*pins([0, 0, 1.0])), 0.2, form=form).warnings
    (warning,) = ck.solve(scene(*pins([0, 0, 1.0], [1.0, 0, 0])), 0.2, form=form).warnings
    assert "'pin 0', 'pin 1'" in warning
    assert "depends on the spacing" in warning
    ring = circle("ring", -0.5, both=ck.Dirichlet(3.0))
    (warning,) = ck.solve(scene(ring, *pins([0, 0, 1.0])), 0.2, form=form).warnings
    assert warning.startswith("Boundary 'pin 0': ")
    cuts = pins([1.0, 0], [0, 1.0])
    assert not ck.solve(scene(*cuts, surface=ck.source("analytic.circle")), 0.1, form=form).warnings
