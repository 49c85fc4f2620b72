"""On every kind of manifold, cut by a plane with Dirichlet data on the cut, finer spacings gain second order.

No exact solution is needed: of three solutions, each on half the spacing of the one before, the second difference
must be about a quarter of the first; in the runs that are always made, curves go by a factor of 1.6 and surfaces by
1.4. A new kind that is not in the lists below fails the suite.
"""

from functools import lru_cache
from itertools import pairwise

import numpy as np
import pytest
from model_problems import order_of

import cpmkit as ck

TURN = [0, 2 * np.pi]
AXES = np.linspace(-1.4, 1.4, 41)


def make(kind, **keys):
    return lambda: ck.source(kind, **keys)


def mesh():
    vertices, faces = ck.source("analytic.torus").mesh(0.06)
    return ck.source("mesh.triangles", vertices=vertices, faces=faces)


def cloud():
    points = ck.source("analytic.sphere").mesh(0.03)[0]
    return ck.source("pointcloud.points", points=points)


def grid():
    x, y, z = np.meshgrid(AXES, AXES, AXES, indexing="ij")
    return ck.source("levelset.grid", values=x**2 + 1.3 * y**2 + z**2 - 1, origin=[-1.4] * 3, spacing=0.07)


def quadric():
    weights = np.array([1, 1.3, 1])
    return ck.source(
        "levelset.callable",
        phi=lambda x: np.sum(x**2 * weights, axis=1) - 1,
        gradient=lambda x: 2 * x * weights,
        bounds=[[-1.4] * 3, [1.4] * 3],
    )


def dumbbell():
    return ck.source("union", members=[ck.source("analytic.sphere", center=[x, 0, 0]) for x in (-2.0, 2.0)])


#: By kind: a maker, and the coarsest spacing.
PLANE_AND_CURVES = {
    "analytic.box": (make("analytic.box", lower=[-1, -1], upper=[1, 1.3]), 0.2),
    "solid": (make("solid", of=ck.source("analytic.circle")), 0.2),
    "analytic.segment": (make("analytic.segment", start=[0, 0], end=[2, 1]), 0.1),
    "analytic.arc": (make("analytic.arc", start=0.3, end=4.0), 0.1),
    "analytic.circle": (make("analytic.circle", normal=[0.2, 0.5, 1]), 0.1),
    "levelset.expression": (make("levelset.expression", phi="x**2 + 2*y**2 - 1", bounds=[[-2, -2], [2, 2]]), 0.1),
    "parametric.curve": (
        make("parametric.curve", x=["cos(t)", "sin(t)", "0.3*sin(2*t)"], range=TURN, periodic=True),
        0.1,
    ),
    "parametric.helix": (make("parametric.helix"), 0.1),
    "parametric.torus_knot": (make("parametric.torus_knot", a=2, b=3, major=1.0, minor=0.4), 0.1),
}
SURFACES = {
    "analytic.sphere": (make("analytic.sphere"), 0.28),
    "analytic.cap": (make("analytic.cap", height=0.1), 0.28),
    "analytic.torus": (make("analytic.torus"), 0.14),
    "analytic.cylinder": (make("analytic.cylinder"), 0.2),
    "mesh.triangles": (mesh, 0.14),
    "levelset.callable": (quadric, 0.2),
    "levelset.grid": (grid, 0.2),
    "parametric.surface": (
        make("parametric.surface", x=["u", "v", "0.3*sin(u)*cos(v)"], u=[-1.5, 1.5], v=[-1, 1]),
        0.2,
    ),
    "parametric.moebius": (make("parametric.moebius"), 0.14),
    "pointcloud.points": (cloud, 0.2),
    "union": (dumbbell, 0.2),
    "moved": (make("moved", of=ck.source("analytic.torus"), rotation=[0.4, 0.1, 0], scale=2.0), 0.28),
    "trimmed": (make("trimmed", of=ck.source("analytic.sphere"), trim="z - 0.6"), 0.2),
    "tube": (make("tube", around=ck.source("analytic.circle", normal=[0, 0, 1]), radius=0.4), 0.14),
}
#: Surfaces that bend so much that only fine grids see them.
CURVED = {
    "levelset.dziuk": (make("levelset.dziuk"), 0.1),
    "levelset.decotetrahedron": (make("levelset.decotetrahedron"), 0.2),
    "levelset.tooth": (make("levelset.tooth"), 0.1),
    "levelset.goursat": (make("levelset.goursat"), 0.16),
    "parametric.revolution": (
        make("parametric.revolution", profile=["1 + 0.3*cos(t)", "0.6*sin(t)"], range=TURN, periodic=True),
        0.1,
    ),
}
KINDS = PLANE_AND_CURVES | SURFACES | CURVED
#: Where the plane would meet the rim at a slant the solution itself has no second derivatives: other cuts, by formula.
CUTS = {
    "analytic.cap": "z - 0.51",
    "trimmed": "z + 0.21",
    "solid": "hypot(x - 0.1, y) - 0.5",
    "analytic.box": "hypot(x - 0.1, y) - 0.5",
    "analytic.cylinder": "z - 0.21",
    "parametric.moebius": "y - 0.1",
    "parametric.surface": "hypot(x - 0.1, y) - 0.6",
}
#: Where cut and rim meet at a slant the solution is no smoother than its corners: the Galerkin form's error is theirs
#: (rms 2.4e-4, 1.1e-4, 2.7e-5 at 0.14, 0.0875, 0.0547), and three spacings show no order.
FORMS = {"parametric.moebius": "collocation"}
#: No manifolds to solve on; polygons, whose corners leave an error at every spacing; and those that cross themselves.
OTHERS = {"analytic.point", "points", "cut.plane", "cut.function", "mesh.edge_loop", "mesh.feature_edges"}
OTHERS |= {"mesh.polyline", "mesh.path", "svg.path", "parametric.klein", "parametric.planar_curve"}


def u(x):
    """Data on the cut."""
    return 0.3 + x[:, 0] * x[:, 1] + np.sin(x[:, -1])


def f(x):
    """Right-hand side."""
    return np.cos(x[:, 0]) - x[:, 1]


def cut(kind, surface):
    if kind in CUTS:
        return ck.source("cut.function", surface=surface, phi=CUTS[kind])
    bounds = np.asarray(surface.bounds)
    normal = np.array([0.83, 0.41, 0.37])[: surface.dim]
    point = bounds.mean(axis=0) + (0.37 if kind == "union" else 0.11) * (bounds[1] - bounds[0]) * np.eye(surface.dim)[0]
    return ck.source("cut.plane", surface=surface, point=point, normal=normal)


@lru_cache(maxsize=1)
def prepared(kind, count, factor):
    """Return points of a manifold and ``count`` sets of tables, each finer by ``factor``, whatever the problem."""
    maker, coarsest = KINDS[kind]
    surface = maker()
    scene = ck.Scene(surface, SCREENED, [ck.Boundary("cut", cut(kind, surface), both=ck.Dirichlet(u))])
    bounds = np.asarray(surface.bounds)
    rng = np.random.default_rng(2)
    points = surface.closest_point(rng.uniform(bounds[0], bounds[1], (1500, surface.dim))).points
    return points, [ck.prepare(scene, coarsest / factor**k, form=FORMS.get(kind, "auto")) for k in range(count)]


def observed_order(kind, problem, count, factor=2.0):
    """Return the slope of the differences, rms over the manifold, of ``count`` solutions, each finer by ``factor``."""
    points, tables = prepared(kind, count, factor)
    solved = [one.solve(problem=problem).evaluate(points) for one in tables]
    differences = [np.sqrt(np.mean((a - b) ** 2)) for a, b in pairwise(solved)]
    return order_of(factor ** -np.arange(count - 1.0), differences)


SCREENED, POISSON = ck.ScreenedPoisson(f, 1.0), ck.Poisson(f)


@pytest.mark.parametrize("problem", [SCREENED, POISSON], ids=["screened", "poisson"])  # first: tables serve both
@pytest.mark.parametrize("kind", PLANE_AND_CURVES)
def test_curves_and_areas(kind, problem):
    assert observed_order(kind, problem, 4, factor=1.6) > 1.6


#: Strips and clouds converge in their plugins' tests; and a torus that is moved, or a circle's tube, is one.
DEAR = ("levelset.grid", "moved", "parametric.moebius", "pointcloud.points", "tube")


@pytest.mark.parametrize("kind", [pytest.param(kind, marks=[pytest.mark.slow] * (kind in DEAR)) for kind in SURFACES])
def test_surfaces(kind):
    assert observed_order(kind, SCREENED, 3, factor=1.4) > 1.6


@pytest.mark.slow
@pytest.mark.parametrize("problem", [SCREENED, POISSON], ids=["screened", "poisson"])
@pytest.mark.parametrize("kind", [*SURFACES, *CURVED])
def test_both_problems_on_surfaces(kind, problem):
    if kind == "union" and problem is POISSON:
        pytest.skip("nothing fixes the solution on the sphere that is not cut")
    assert observed_order(kind, problem, 3) > 1.6


def test_every_installed_manifold_is_listed():
    sources = {kind.name for kind in ck.kinds() if kind.sort == "source"}
    assert sources - set(KINDS) - OTHERS == set()
    assert set(KINDS) <= sources
