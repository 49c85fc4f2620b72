"""Every installed source that gives cells gives good ones: conforming, on the manifold and its rim, of its measure."""

import numpy as np
import pytest
from made_cases import CASES, source_of
from sample_shapes import octahedron

import cpmkit as ck
from cpmkit.mesh.adjacency import half_facets, repair
from cpmkit.mesh.cell_quadrature import quadrature
from cpmkit.mesh.subdivision import subdivide
from cpmkit.meshing.curved_from_normals import curve_cells
from cpmkit.meshing.source_cells import source_cells
from cpmkit.plugin import Advice, localize

CELLED = [
    case
    for case in CASES
    if case.kind.partition(".")[0] in ("analytic", "parametric", "mesh", "cut", "trimmed", "moved", "union")
]


def centred(source):
    bounds = np.asarray(source.bounds, dtype=np.float64)
    return localize(source, bounds.mean(axis=0)), float(np.ptp(bounds, axis=0).max())


def sampled(source, spacing):
    drawn = source_cells(source, 0.5 * spacing)  # of one kind: areas of others differ by 1e-7
    mesh = subdivide(repair(drawn.mesh)[0], 0.55 * spacing)
    mesh = curve_cells(mesh, drawn.geometry, source, (), spacing)
    return mesh, quadrature(mesh)


@pytest.mark.parametrize("case", CELLED, ids=str)
def test_cells_are_on_the_manifold_and_end_on_its_rim(case):
    source, size = centred(source_of(case))
    if source.manifold_dim is None or not 0 < source.manifold_dim < source.dim:
        assert source_cells(source, size / 10) is None
        return
    spacing = size / 10
    mesh, samples = sampled(source, spacing)
    off = np.linalg.norm(source.closest_point(samples.points).points - samples.points, axis=1)
    # a mesh that is read as smooth stands above the flat triangles on which its feet lie
    share = 0.01 if source.source.exact else 0.04
    assert samples.weights @ off / samples.weights.sum() < share * spacing
    gram = np.einsum("qid,qjd->qij", samples.normals, samples.normals)
    assert gram == pytest.approx(np.broadcast_to(np.eye(gram.shape[1]), gram.shape), abs=1e-12)
    seen = half_facets(mesh)
    ends = np.unique(mesh.facets[seen.cell, seen.facet])
    if not len(ends):
        return
    rim = mesh.vertices[ends]
    assert np.linalg.norm(rim - source.closest_point(rim).points, axis=1).max() < share * spacing
    around = rim[:, None] + 0.3 * spacing * np.vstack([np.eye(source.dim), -np.eye(source.dim)])
    edge = source.closest_point(around.reshape(-1, source.dim)).edge.reshape(len(ends), -1)
    assert (edge >= 0).any(axis=1).all()


@pytest.mark.parametrize(
    "kind", [case for case in CELLED if case.kind in ("analytic.sphere", "parametric.moebius", "trimmed")], ids=str
)
def test_measures_settle_quickly(kind):
    source, size = centred(source_of(kind))
    areas = [sampled(source, size / n)[1].weights.sum() for n in (6, 12, 24)]
    assert abs(areas[2] - areas[1]) < abs(areas[1] - areas[0]) / 3
    assert abs(areas[2] - areas[1]) < 1e-4 * areas[2]


def test_level_sets_in_space_and_clouds_are_left_to_closest_points(monkeypatch):
    """And not drawn for nothing."""
    ball = ck.source("levelset.expression", phi="x**2 + y**2 + z**2 - 1", bounds=[[-1.5] * 3, [1.5] * 3])
    cloud = ck.source("pointcloud.points", points=octahedron(4).vertices)
    for source in (ball, cloud):
        monkeypatch.setattr(type(source), "advice", lambda self, spacing: Advice())
        assert source_cells(centred(source)[0], 0.2) is None
        monkeypatch.undo()
        with monkeypatch.context() as patched:
            patched.setattr(type(source), "mesh", None)
            assert source_cells(centred(source)[0], 0.2) is None
    ring = ck.source("levelset.expression", phi="x**2 + y**2 - 1", bounds=[[-1.5] * 2, [1.5] * 2])
    assert source_cells(centred(ring)[0], 0.1) is not None


def test_members_of_a_union_stand_side_by_side_unless_they_meet():
    def balls(distance):
        members = [ck.source("analytic.sphere", center=[x, 0.0, 0.0]) for x in (0.0, distance)]
        return centred(ck.source("union", members=members))[0]

    drawn = source_cells(balls(2.05), 0.14, 0.1)
    assert drawn.geometry == "closest_point"
    assert len(repair(drawn.mesh)[0].cells) == 2 * len(
        source_cells(centred(ck.source("analytic.sphere"))[0], 0.14, 0.1).mesh.cells
    )
    assert source_cells(balls(1.5), 0.14, 0.1) is None
