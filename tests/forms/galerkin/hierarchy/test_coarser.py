"""Coarser splines are finer ones too, patch by patch, whichever of its patches tells a finer unknown's copies."""

from itertools import pairwise, product

import numpy as np
import pytest
from galerkin_scenes import circle, plane, plane_circle, space_circle, sphere, together
from scipy.sparse.csgraph import connected_components

from cpmkit.forms.galerkin.dof_map import build_dof_map
from cpmkit.forms.galerkin.space.levels import coarsen, coarser_levels
from cpmkit.forms.galerkin.space.spline_space import value_rows

H = 0.05
UP = np.cross(*np.linalg.qr(np.random.default_rng(3).normal(size=(3, 2)))[0].T)
SCENES = {
    "sphere": lambda: sphere(2 * H),
    "circle": lambda: plane_circle(H),
    "circle in space": lambda: space_circle(H),
    "circle with a cut": lambda: circle(H, np.array([1.0, 0.0]), np.array([0.0, 1.0]), np.zeros(2), 2 * np.pi - 1e-9),
    "two slit squares": lambda: together(*[plane(H, slit=(0.3, 1.1)).moved(0.3 * H * k * UP) for k in (0, 1)]),
}


def points_and_dof_map(name):
    drawn = SCENES[name]()
    return drawn.samples.points, build_dof_map(drawn.samples.points, drawn.contacts, H)


@pytest.mark.parametrize("name", SCENES)
def test_a_coarser_spline_is_a_finer_one(name):
    points, fine = points_and_dof_map(name)
    for _ in range(4):
        coarse, prolongation = coarsen(fine)
        u = np.random.default_rng(1).standard_normal(coarse.size)
        moved = points - fine.spacing / 2  # relative to the coarser lattice's origin
        finer = value_rows(fine, fine.patch, points) @ (prolongation @ u)
        assert abs(finer - value_rows(coarse, coarse.patch, moved) @ u).max() < 1e-12
        assert abs(prolongation.sum(axis=1) - 1).max() < 1e-14
        assert prolongation.has_canonical_format
        assert np.unique(coarse.unknowns).tolist() == list(range(coarse.size))
        fine, points = coarse, moved


@pytest.mark.parametrize("name", SCENES)
def test_all_patches_that_read_an_unknown_agree_on_its_parents(name):
    fine = points_and_dof_map(name)[1]
    coarse, prolongation = coarsen(fine)
    parent = np.empty(len(fine.cells), dtype=np.int64)
    parent[fine.patch] = coarse.patch
    for place, unknowns in zip(product(range(3), repeat=fine.dim), fine.unknowns.T, strict=True):
        node = fine.cells + np.array(place) - 1
        for choice in product((0, 1), repeat=fine.dim):
            at = (node >> 1) + np.array(choice) * np.where(node % 2, 1, -1) - coarse.cells[parent] + 1
            column = coarse.unknowns[parent, np.ravel_multi_index(tuple(at.T), (3,) * fine.dim)]
            weight = np.where(np.array(choice), 0.25, 0.75).prod()
            assert np.allclose(np.asarray(prolongation[unknowns, column]), weight, rtol=1e-14)


def test_what_does_not_touch_stays_apart():
    cut, whole = points_and_dof_map("circle with a cut")[1], points_and_dof_map("circle")[1]
    for _ in range(4):
        (cut, _), (whole, _) = coarsen(cut), coarsen(whole)
        assert len(cut.cells) > len(np.unique(cut.cells, axis=0))
        assert len(whole.cells) == len(np.unique(whole.cells, axis=0))
    squares = points_and_dof_map("two slit squares")[1]
    for _ in range(3):
        squares = coarsen(squares)[0]
        assert len(squares.nodes) > 2 * len(np.unique(squares.nodes, axis=0))  # two sheets, and more along the slits
        one, two = (squares.unknowns[half] for half in np.split(squares.patch, 2))
        assert not len(np.intersect1d(one, two))


def test_a_piece_within_two_cells_has_one_unknown():
    big, small = sphere(2 * H), sphere(2 * H).moved(0.3, scale=2.2 * H)
    scene, count = together(big, small), len(big.samples)
    dof_map = build_dof_map(scene.samples.points, scene.contacts, H)
    kept = []
    for _ in range(4):
        kept.append(len(np.unique(dof_map.unknowns[dof_map.patch[count:]])))
        dof_map, prolongation = coarsen(dof_map)
        assert abs(prolongation.sum(axis=1) - 1).max() < 1e-14
        if kept[-1] == 1:  # and stays the one of its own
            alone = np.unique(dof_map.unknowns[dof_map.patch[count:]])
            assert len(alone) == 1
            assert set(prolongation[:, alone].tocsc().data) == {1.0}
    assert kept[0] > 100
    assert kept[-1] == 1


def test_levels_end_at_a_few_hundred_unknowns_and_tell_the_strip():
    points, fine = points_and_dof_map("sphere")
    beside = np.unique(fine.patch[abs(points[:, 2] - 0.3) < H / 3])
    levels = coarser_levels(fine, beside)
    assert levels[-1].prolongation.shape[1] <= 400 < levels[-1].prolongation.shape[0]
    assert levels[0].strip.tolist() == np.unique(fine.unknowns[beside]).tolist()
    for level, after in pairwise(levels):
        fine, prolongation = coarsen(fine)
        assert (prolongation != level.prolongation).nnz == 0
        assert np.isin(after.strip, np.unique(prolongation[level.strip].indices)).all()
        assert 0.4 * len(level.strip) < len(after.strip) < 0.7 * len(level.strip)
    assert coarser_levels(coarsen(fine)[0], np.zeros(0, dtype=np.int64)) == []


def test_a_thousand_specks_end_the_levels():
    one = sphere(1.0).moved(0.0, scale=0.5 * H)
    scene = together(*[one.moved(4 * H * np.array([i, j, k])) for i, j, k in product(range(10), repeat=3)])
    fine = build_dof_map(scene.samples.points, scene.contacts, H)
    assert fine.size == 1000
    assert coarser_levels(fine, np.zeros(0, dtype=np.int64)) == []


def test_pieces_keep_apart_on_all_levels():
    one = sphere(2 * H)
    scene = together(one, one.moved(0.2 * H), one.moved(np.array([2.0 + 0.3 * H, 0.0, 0.0])))
    for level in coarser_levels(build_dof_map(scene.samples.points, scene.contacts, H), np.zeros(0, dtype=np.int64)):
        coupled = level.prolongation.T @ level.prolongation
        assert connected_components(coupled, directed=False)[0] == 3
