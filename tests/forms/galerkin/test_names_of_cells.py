"""Warnings speak of a mesh to those who gave one; else of the triangulation of the surface, with another advice."""

import numpy as np
import pytest

import cpmkit as ck
from cpmkit.mesh.adjacency import RepairReport
from cpmkit.meshing.mesh_warnings import repair_warnings, seam_warnings
from cpmkit.plugin import localize

SHEET = np.stack(np.meshgrid(np.linspace(-1, 1, 17), np.linspace(-1, 1, 17)), axis=-1).reshape(-1, 2)


def test_a_mesh_of_the_users_is_named_and_so_is_a_triangulation():
    repaired = RepairReport(welded=0, doubled=2, fans=1)
    for bend in ("flat", "normals"):
        cells, touch = repair_warnings(repaired, bend)
        assert cells.startswith("2 cells of the mesh had")
        assert "clean the mesh" in cells
        assert touch.startswith("Parts of the mesh touch")
        assert "join them by an edge" in touch
    for text in repair_warnings(repaired, "closest_point"):
        assert "of the triangulation of the surface" in text
        assert "use a smaller spacing" in text
        assert "mesh" not in text


def test_rims_that_lie_on_others_are_welded_in_a_mesh_alone():
    surface = localize(ck.source("analytic.sphere"), np.zeros(3))
    (of_mesh,) = seam_warnings(np.zeros((1, 3)), surface, "normals")
    (of_triangulation,) = seam_warnings(np.zeros((1, 3)), surface, "closest_point")
    assert "weld the vertices of the mesh there if it should" in of_mesh
    assert "use a smaller spacing if it should" in of_triangulation
    assert "mesh" not in of_triangulation


def test_a_cloud_whose_sheets_touch_hears_nothing_of_a_mesh():
    points = np.concatenate([np.c_[SHEET, 0 * SHEET[:, 0]], np.c_[SHEET, 0 * SHEET[:, 0] + 0.05]])
    cloud = ck.source("pointcloud.points", points=points, closed=False)
    with pytest.raises(ck.CpmkitError, match="neighbours of 578 of 578 samples lie on several sheets") as refused:
        ck.solve(ck.Scene(cloud, ck.ScreenedPoisson("x")), spacing=0.15, form="galerkin")
    assert "mesh" not in str(refused.value)
