"""Samples as a space holds them: off by a unit of fixed point at most, with orthonormal normals and their cells."""

import numpy as np
import pytest
from galerkin_scenes import sphere

from cpmkit.forms.galerkin.dof_map import build_dof_map
from cpmkit.forms.galerkin.space.quantised_samples import QuantisedSamples
from cpmkit.mesh.cell_quadrature import Samples

H = 0.2


def fixed(drawn, samples=None):
    samples = drawn.samples if samples is None else samples
    return QuantisedSamples.of(samples, build_dof_map(samples.points, drawn.contacts, H))


def test_points_and_normals_are_rounded_to_a_unit():
    drawn = sphere(0.55 * H)
    one = fixed(drawn)
    assert one.places.dtype == one.directions.dtype == np.int32
    assert 0 < np.abs(one.points - drawn.samples.points).max() <= 0.51 * 2.0**-32 * H
    assert 0 < np.abs(one.normals - drawn.samples.normals).max() <= 4 * 2.0**-30
    assert np.abs(np.linalg.norm(one.normals, axis=2) - 1).max() < 1e-15
    assert np.array_equal(one.weights, drawn.samples.weights)


def test_some_samples_are_those_of_all():
    drawn = sphere(0.55 * H)
    one, rows = fixed(drawn), np.array([[5, 0], [7, 3]])
    assert np.array_equal(one.points_at(rows), one.points[rows])
    assert np.array_equal(one.normals_at(rows), one.normals[rows])
    assert np.array_equal(one.cell_at(rows), drawn.samples.cell[rows])


@pytest.mark.parametrize("last", [0, 5])
def test_cells_are_kept_whatever_follows(last):
    """Samples on boundaries stand behind those of the manifold, and their cells begin anew."""
    drawn, s = sphere(0.55 * H), sphere(0.55 * H).samples
    again = np.concatenate([np.arange(len(s)), np.arange(last)[::-1] * 7])
    samples = Samples(s.points[again], s.weights[again], s.normals[again], s.cell[again])
    dof_map = build_dof_map(samples.points, drawn.contacts[again], H)
    one = QuantisedSamples.of(samples, dof_map)
    assert np.array_equal(one.cell, samples.cell)
    assert np.array_equal(one.cell_at(np.arange(len(samples))), samples.cell)


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_normals_along_axes_are_exact(axis, sign):
    normal = np.zeros((1, 1, 3))
    normal[0, 0, axis] = sign
    samples = Samples(np.full((1, 3), 0.25 * H), np.ones(1), normal, np.zeros(1))
    one = QuantisedSamples.of(samples, build_dof_map(samples.points, np.zeros((1, 3), dtype=np.int64), H))
    assert np.array_equal(one.normals, normal)
    assert np.array_equal(one.points, samples.points)
