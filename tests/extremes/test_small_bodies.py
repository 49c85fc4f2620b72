"""Parts of machines: closed meshes, on which cuts at creases gain more than the same unknowns at a smaller spacing."""

import numpy as np
import pytest
from extremes.small_geometry_cases import PARTS

import cpmkit as ck
from cpmkit.mesh.mesh import Mesh


@pytest.mark.parametrize("name", PARTS)
def test_parts_are_closed_and_wound_outwards(name):
    mesh = Mesh.of(*PARTS[name]().scene.surface.mesh(0.1))
    assert (np.bincount(mesh.connectivity.facet_numbers.ravel()) == 2).all()
    assert (mesh.winding == 1).all()
    a, b, c = mesh.vertices[mesh.cells].transpose(1, 0, 2)
    assert np.einsum("ij,ij->", a, np.cross(b, c)) > 0


def test_cuts_on_a_bracket_gain_more_than_a_smaller_spacing(monkeypatch):
    """Its creases are convex, reentrant, and the rims of a bore."""
    scene = PARTS["bracket"]()
    u, errors, unknowns = scene.truth()[0], [], []
    for h in (0.095, 0.07):
        solution = ck.solve(scene.scene, h, origin=np.full(3, 0.123 * h))
        errors.append(np.sqrt(np.mean((solution.evaluate(scene.points) - u) ** 2)) / np.ptp(u))
        unknowns.append(solution.work.unknowns)
        module = "cpmkit.forms.galerkin.scene_sampling"
        monkeypatch.setattr(f"{module}.crease_facets", lambda *_: np.zeros((0, 2), dtype=np.int64))
    assert unknowns[0] < 1.05 * unknowns[1]
    assert errors[0] < 0.8 * errors[1]
