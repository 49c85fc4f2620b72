"""An unknown is a node and a component of the patches that read it, for sheets, slits and specks alike."""

import numpy as np
import pytest
from galerkin_scenes import SHIFT, plane, plane_circle, space_circle, sphere, together
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from cpmkit.forms.galerkin.dof_map import build_dof_map, connected_pieces

H = 0.1


def dof_map_of(drawn, spacing=H):
    return build_dof_map(drawn.samples.points, drawn.contacts, spacing)


def components(pairs, n):
    pairs = np.asarray(pairs).reshape(-1, 2)
    return connected_components(coo_array((np.ones(len(pairs)), pairs.T), shape=(n, n)), directed=False)[1]


def read_by_samples(dof_map):
    """The unknowns that each sample reads, by node offset."""
    return dof_map.unknowns[dof_map.patch]


def same_up_to_numbering(one, two):
    pairs = np.unique(np.stack([one.ravel(), two.ravel()]), axis=1)
    return len(np.unique(pairs[0])) == len(np.unique(pairs[1])) == pairs.shape[1]


def test_a_sheet_has_one_unknown_a_node():
    dof_map = dof_map_of(sphere(0.5 * H).moved(SHIFT))
    # But where a cell holds two parts that come together outside of it only; such copies do no harm.
    assert len(np.unique(dof_map.nodes, axis=0)) > 0.99 * dof_map.size
    assert dof_map.size == pytest.approx(4.5 * 4 * np.pi / H**2, rel=0.05)
    assert connected_pieces(dof_map)[0] == 1


@pytest.mark.parametrize("drawn", [sphere(0.5 * H), plane_circle(H), space_circle(H)], ids=["sphere", "plane", "space"])
def test_patches_read_the_nodes_around_their_cell(drawn):
    dof_map = dof_map_of(drawn)
    around = np.stack(np.meshgrid(*[[-1, 0, 1]] * dof_map.dim, indexing="ij"), axis=-1).reshape(-1, dof_map.dim)
    assert np.array_equal(dof_map.nodes[dof_map.unknowns], dof_map.cells[:, None] + around)
    assert np.array_equal(dof_map.cells[dof_map.patch], np.floor(drawn.samples.points / H + 0.5))


@pytest.mark.parametrize("slit", [None, (-1.0, 2.0), (-1.0, 0.55), (0.2, 0.8)])
def test_the_rule_as_it_is_written(slit):
    drawn = plane(0.5 * H, slit=slit)
    dof_map = dof_map_of(drawn)
    q = len(drawn.contacts)
    vertex, sample = drawn.contacts.ravel(), np.arange(q).repeat(3)
    by_vertex = [sample[vertex == v] for v in np.unique(vertex)]
    touch = np.concatenate([np.stack(np.meshgrid(s, s), axis=-1).reshape(-1, 2) for s in by_vertex])
    cell = np.unique(dof_map.cells[dof_map.patch], axis=0, return_inverse=True)[1].ravel()
    patch = components(touch[cell[touch[:, 0]] == cell[touch[:, 1]]], q)
    assert same_up_to_numbering(patch, dof_map.patch)
    pairs = np.unique(np.sort(dof_map.patch[touch], axis=1), axis=0)
    assert np.array_equal(pairs[pairs[:, 0] < pairs[:, 1]], dof_map.touching)
    node = np.unique(dof_map.nodes[dof_map.unknowns].reshape(-1, 3), axis=0, return_inverse=True)[1]
    node = node.reshape(dof_map.unknowns.shape)
    joined = []
    for a, b in dof_map.touching:
        _, at, too = np.intersect1d(node[a], node[b], return_indices=True)
        joined.append(np.stack([27 * a + at, 27 * b + too], axis=1))
    assert same_up_to_numbering(components(np.concatenate(joined), dof_map.unknowns.size), dof_map.unknowns)


def test_what_is_cut_through_shares_nothing_and_what_is_slit_hangs_together():
    whole, slit, halves = (dof_map_of(plane(0.5 * H, slit=s)) for s in (None, (0.2, 0.8), (-1.0, 2.0)))
    assert [connected_pieces(p)[0] for p in (whole, slit, halves)] == [1, 1, 2]
    assert whole.size < slit.size < halves.size
    copies = np.unique(slit.nodes, axis=0, return_counts=True)[1]
    assert copies.max() == 2


def test_two_sheets_a_fraction_of_the_spacing_apart_share_nothing():
    inner, outer = sphere(0.5 * H), sphere(0.5 * H, radius=1 + 0.3 * H)
    dof_map = dof_map_of(together(inner, outer))
    count, of_unknown = connected_pieces(dof_map)
    apart = dof_map.patch < 0
    apart[len(inner.contacts) :] = True
    assert count == 2
    assert len(np.unique(dof_map.nodes, axis=0)) < 0.75 * dof_map.size
    assert not set(read_by_samples(dof_map)[apart].ravel()) & set(read_by_samples(dof_map)[~apart].ravel())
    assert len(set(of_unknown[read_by_samples(dof_map)[apart]].ravel())) == 1


@pytest.mark.parametrize("drawn", [plane(0.5 * H, slit=(0.2, 0.8)), plane_circle(H), space_circle(H)])
def test_neither_the_order_of_samples_nor_whole_spacings_nor_units_count(drawn):
    drawn = drawn.moved(np.zeros(drawn.samples.points.shape[1]))
    usual = dof_map_of(drawn)
    order = np.random.default_rng(2).permutation(len(drawn.contacts))
    shuffled = dof_map_of(drawn.reordered(order))
    assert same_up_to_numbering(read_by_samples(usual)[order], read_by_samples(shuffled))
    far = np.array([1000, -2000, 30])[: usual.dim]
    moved = dof_map_of(drawn.moved(far * H))
    assert np.array_equal(moved.unknowns, usual.unknowns)
    assert np.array_equal(moved.nodes, usual.nodes + far)
    for unit in (1e-6, 1e6):
        scaled = dof_map_of(drawn.moved(0.0, unit), H * unit)
        assert np.array_equal(scaled.unknowns, usual.unknowns)
        assert np.array_equal(scaled.nodes, usual.nodes)


def test_a_speck_has_one_unknown_and_what_is_larger_has_more():
    places = np.random.default_rng(4).uniform(-3, 3, (50, 3))
    specks = [plane(0.5 * H, side=1.5 * H).moved(place) for place in places]
    dof_map = dof_map_of(together(sphere(0.5 * H), *specks))
    count, of_unknown = connected_pieces(dof_map)
    assert count == 51
    assert sorted(np.bincount(of_unknown))[:50] == [1] * 50
    assert dof_map_of(plane(0.5 * H, side=3 * H)).size > 27
