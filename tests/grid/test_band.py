"""The band holds every node that a stencil at any surface point reads, and no dense box."""

import numpy as np
import pytest
from bare import Bare
from model_problems import sphere_points

import cpmkit as ck
from cpmkit import ClosestPoints, build_band
from cpmkit.grid.band import reading_radius, stencil_cells, tensor_offsets
from cpmkit.grid.lattice import Codes, Lattice, suggest_spacing
from cpmkit.plugin import localize


def sphere_band(spacing, degree=3):
    return build_band(localize(ck.source("analytic.sphere"), np.zeros(3)), spacing, degree)


@pytest.mark.parametrize("degree", [2, 3, 4, 5])
def test_every_surface_point_has_its_stencil(degree):
    band = sphere_band(0.13, degree)
    cells, _ = stencil_cells(sphere_points(10_000), band.spacing, degree)
    assert np.all(band.find_inner(cells[:, None] + tensor_offsets(degree, 3)) >= 0)


def test_inner_nodes_have_all_difference_neighbours():
    band = sphere_band(0.1)
    numbers = band.find(band.nodes[: band.inner, None] + np.concatenate([np.eye(3, dtype=int), -np.eye(3, dtype=int)]))
    assert np.all(numbers >= 0)
    np.testing.assert_array_equal(band.nodes[numbers[:, 0]], band.nodes[: band.inner] + [1, 0, 0])


def test_inner_nodes_lie_within_reach_and_are_few_more_than_the_stencils_read():
    band = sphere_band(0.1)
    reach = reading_radius(3, 3) * band.spacing
    assert band.feet.distance[: band.inner].max() <= reach * (1 + 1e-9) + np.sqrt(3) / 2 * band.spacing
    cells, _ = stencil_cells(sphere_points(100_000), band.spacing, 3)
    read = np.unique(band.find_inner(np.unique(cells, axis=0)[:, None] + tensor_offsets(3, 3)))
    assert len(read) <= band.inner <= 1.1 * len(read)


def test_nodes_grow_like_the_surface_not_the_box():
    counts = [len(sphere_band(h).nodes) for h in (0.14, 0.07, 0.035)]
    assert 3.5 < counts[1] / counts[0] < 4.2
    assert 3.8 < counts[2] / counts[1] < 4.1


class TwoSpheres:
    """Two spheres far apart, as one source."""

    dim, manifold_dim, exact = 3, 2, True
    bounds = np.array([[-1.0, -1, -1], [41, 1, 1]])
    parts = (ck.source("analytic.sphere"), ck.source("analytic.sphere", center=[40, 0, 0]))

    def closest_point(self, x, /):
        one, two = (part.closest_point(x) for part in self.parts)
        first = (one.distance <= two.distance)[:, None]
        return ClosestPoints(
            np.where(first, one.points, two.points), np.minimum(one.distance, two.distance), np.full(len(x), -1)
        )


def test_pieces_far_apart_are_all_found():
    pair = build_band(localize(TwoSpheres(), np.zeros(3)), 0.1, 3)
    single = sphere_band(0.1)
    assert pair.inner == 2 * single.inner
    assert np.count_nonzero(pair.nodes[:, 0] > 200) == len(single.nodes)


def test_a_source_without_abilities_gives_the_same_band():
    bare = build_band(localize(Bare(ck.source("analytic.sphere")), np.zeros(3)), 0.1, 3)
    np.testing.assert_array_equal(bare.nodes, sphere_band(0.1).nodes)


def test_a_point_outside_the_numbered_box_has_no_code():
    """Its number would be that of another point: (0, 3) is numbered as (1, 0) is, in a box of 2 by 3."""
    codes = Codes.from_points(np.array([[0, 0], [1, 2]]), 0)
    inside = np.array([[0, 0], [1, 0], [1, 2]])
    np.testing.assert_array_equal(codes.decode(codes.encode(inside)), inside)
    np.testing.assert_array_equal(codes.encode(np.array([[0, 3], [-1, 5], [2, 0], [0, -1]])), -1)


def test_spacings_suggested_for_points_are_fine_enough_and_one_point_loses_nothing_to_rounding():
    many = ck.source("points", at=np.random.default_rng(0).uniform(size=(50, 3)))
    assert 0.0 < suggest_spacing(many) < 0.1
    assert Lattice(np.array([1e9, 0.0]), 0.1).rounding_warnings(np.zeros((2, 2)), translated=False) == ()
