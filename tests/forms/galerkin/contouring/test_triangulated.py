"""Surfaces known by closest points alone are triangulated with the right pieces and rims, and areas of order four."""

from __future__ import annotations

from math import pi

import numpy as np
import pytest
from forms.galerkin.contouring.measures import area, topology

import cpmkit as ck
from cpmkit.forms.galerkin.contouring.surfaces import triangulated
from cpmkit.manifold.local_source import localize

SMOOTH = {
    "sphere": ({"kind": "analytic.sphere"}, 4 * pi, (1, 0, 2)),
    "torus": ({"kind": "analytic.torus", "major": 1.0, "minor": 0.4}, 1.6 * pi**2, (1, 0, 0)),
    "hemisphere": ({"kind": "analytic.cap", "height": 0.0}, 2 * pi, (1, 1, 1)),
}


def made(kind, **keys):
    return ck.source(kind, **keys)


def contoured(source, spacing, origin=None):
    """Return the mesh, the report, and how many queries were asked for each unknown that there will be."""
    seen = localize(source, source.bounds.mean(axis=0) if origin is None else np.asarray(origin, dtype=float))
    mesh, report = triangulated(seen, spacing)
    return mesh, report, seen.queries["points"] / (4.5 * area(mesh) / spacing**2)


@pytest.mark.parametrize("name", SMOOTH)
def test_areas_of_smooth_surfaces_are_of_order_four(name):
    keys, exact, shape = SMOOTH[name]
    errors = []
    for spacing in (0.2, 0.1, 0.05):
        mesh, report, queries = contoured(made(**keys), spacing)
        assert topology(mesh) == shape
        assert report.open_edges == 0
        assert report.nonmanifold_share == 0
        assert queries < 22
        errors.append(abs(area(mesh) / exact - 1))
    assert errors[1] < 1e-6
    assert np.log2(errors[0] / errors[2]) / 2 > 3.4
