"""Every installed kind of surface and curve is contoured from its closest points alone as it draws itself."""

from __future__ import annotations

from math import pi

import numpy as np
import pytest
from made_cases import CASES, source_of
from meshing.contouring.measures import area, length, pieces, topology

from cpmkit.meshing.contouring.contoured_curves import contour_curve
from cpmkit.meshing.contouring.contoured_surfaces import contour_surface
from cpmkit.meshing.curved_from_points import curve_cells_by_closest_points
from cpmkit.plugin import Mesh, localize

#: Components, pieces of the border and Euler characteristic, where they are not those of a sphere.
SHAPES = {
    "cap": (1, 1, 1),
    "torus": (1, 0, 0),
    "cylinder": (1, 2, 0),
    "dome": (1, 1, 1),
    "torus with two edges": (1, 2, 0),
    "cylinder across": (1, 1, 1),
    "decotetrahedron": (1, 0, -4),
    "goursat": (1, 0, -8),
    "saddle": (1, 1, 1),
    "moebius": (1, 1, 0),
}
#: Areas, and the length of an ellipse, of clouds, which do not draw themselves.
AREAS = {"(curve)": 5.10539977, "small sphere": 4e-6 * pi, "sphere": 4 * pi, "torus of degree 4": 1.6 * pi**2}
#: No surface, or one whose cells are taken as they are: coarse creases between its facets are no part of its shape.
LEFT_OUT = ("mesh.triangles", "mesh.path", "svg.path", "(nearest)")
#: Components of curves that have several.
COMPONENTS = {
    "two circles": 2,
    "two loops": 2,
    "two open pieces": 2,
    "cut.function (torus)": 2,
    "both offsets of a circle": 2,
}
#: Kinds of curves that end, and how many ends they have; others are closed.
ENDS = {
    "two open pieces": 4,
    "arc": 2,
    "segment": 2,
    "offset of a segment, closed": 0,
    "helix": 2,
    "open": 2,
    "one that ends": 2,
    "sharply curved": 2,
    "(callable)": 2,
}


#: Dear level sets, and a surface that meets itself: others of their kinds run always. They are made where they run.
SLOW = ("goursat", "decotetrahedron", "tooth", "klein")
#: Dimensions of sources in space that take long to be made: these are made where they are tested, not while tests are
#: collected.
DIMENSIONS = {
    "cut.function (curve in space)": 0,
    "cut.function (torus)": 1,
    "cut.plane (torus, two loops)": 1,
    "levelset.dziuk (whole)": 2,
    "levelset.expression (dome, trimmed)": 2,
    "levelset.expression (sphere of a micrometre)": 2,
    "levelset.expression (torus)": 2,
    "levelset.grid (ellipsoid)": 2,
    "pointcloud.points (small sphere far from zero)": 2,
    "pointcloud.points (sphere)": 2,
    "pointcloud.points (sphere with normals)": 2,
    "pointcloud.points (torus of degree 4)": 2,
    "trimmed (cylinder across its rims)": 2,
    "trimmed (sphere to a cap)": 2,
    "trimmed (torus with two edges)": 2,
}


def holds(case, words):
    """Tell whether the case's name holds one of the words."""
    return any(word in str(case) for word in words)


def cases(dimension):
    """Return the cases of this dimension that are not slow."""
    selected = [case for case in CASES if not holds(case, (*LEFT_OUT, *SLOW))]

    def of(case):
        return DIMENSIONS[str(case)] if str(case) in DIMENSIONS else dimension_of(source_of(case))

    return [case for case in selected if of(case) == dimension]


def dimension_of(source):
    """Return the dimension of a curve or surface; None of a solid, and of cells of several dimensions."""
    return source.manifold_dim if source.manifold_dim != source.dim else None


def table(values, case, default):
    """Return the entry of the longest key that the case's name holds."""
    selected = [key for key in values if key in str(case)]
    return values[max(selected, key=len)] if selected else default


def drawn_size(source, case, spacing):
    """Return the area or length of the source's own drawing."""
    if table(AREAS, case, None) and "pointcloud" in case.kind:
        return table(AREAS, case, None)
    vertices, cells = source.mesh(spacing)
    if cells.shape[1] == 2:
        return np.linalg.norm(np.diff(vertices[cells], axis=1)[:, 0], axis=1).sum()
    return area(Mesh.of(vertices, cells))


SLOW_SURFACES = [pytest.param(case, marks=pytest.mark.slow) for case in CASES if holds(case, SLOW)]


@pytest.mark.parametrize("case", [*cases(2), *SLOW_SURFACES], ids=str)
def test_surfaces(case):
    source = source_of(case)
    assert dimension_of(source) == 2
    spacing = float(np.ptp(source.bounds, axis=0).max()) / 16
    seen = localize(source, source.bounds.mean(axis=0))
    mesh, report = contour_surface(seen, spacing)
    mesh = curve_cells_by_closest_points(mesh, seen)
    assert area(mesh) == pytest.approx(drawn_size(source, case, spacing / 2), rel=6e-3)
    assert len(report.missed) == 0
    if "klein" not in case.kind:  # it meets itself
        assert topology(mesh) == table(SHAPES, case, (1, 0, 2))
        assert len(report.defects.cracks) == 0


@pytest.mark.parametrize("case", cases(1), ids=str)
def test_curves(case):
    source = source_of(case)
    assert dimension_of(source) == 1
    spacing = float(np.ptp(source.bounds, axis=0).max()) / 30
    seen = localize(source, source.bounds.mean(axis=0))
    mesh, defects = contour_curve(seen, spacing)
    mesh = curve_cells_by_closest_points(mesh, seen)
    assert length(mesh) == pytest.approx(drawn_size(source, case, spacing / 8), rel=2e-3)
    assert np.sum(np.bincount(mesh.cells.ravel()) == 1) == table(ENDS, case, 0)
    assert pieces(mesh.cells) == table(COMPONENTS, case, 1)
    assert defects.count == 0
