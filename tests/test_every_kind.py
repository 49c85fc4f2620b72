"""On every kind of manifold, cut by a plane with Dirichlet data on the cut, halving the spacing gains second order.

No exact solution is needed: of three solutions, each on half the spacing of the one before, the second difference
must be about a quarter of the first. A new kind that is not in the lists below fails the suite.
"""

import numpy as np
import pytest

import cpmkit as ck
from cpmkit.plugins import factory, installed_kinds, load

TURN = [0, 2 * np.pi]
AXES = np.linspace(-1.4, 1.4, 41)


def make(kind, **keys):
    return lambda: ck.source(kind, **keys)


def mesh():
    vertices, faces = ck.source("analytic.torus").mesh(0.02)
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


#: By kind: a maker, the coarsest of the three spacings, and the least order.
KINDS = {
    "analytic.segment": (make("analytic.segment", start=[0, 0], end=[2, 1]), 0.1, 1.8),
    "analytic.arc": (make("analytic.arc", start=0.3, end=4.0), 0.1, 1.8),
    "analytic.circle": (make("analytic.circle", normal=[0.2, 0.5, 1]), 0.1, 1.8),
    "analytic.sphere": (make("analytic.sphere"), 0.2, 1.8),
    "analytic.cap": (make("analytic.cap", height=0.1), 0.2, 1.8),
    "analytic.torus": (make("analytic.torus"), 0.14, 1.8),
    "analytic.cylinder": (make("analytic.cylinder"), 0.2, 1.8),
    "analytic.box": (make("analytic.box", lower=[-1, -1], upper=[1, 1.3]), 0.1, 1.8),
    "mesh.polyline": (make("mesh.polyline", points=ck.source("analytic.circle").mesh(0.01)[0], closed=True), 0.1, 1.8),
    "mesh.triangles": (mesh, 0.14, 1.8),
    "levelset.expression": (make("levelset.expression", phi="x**2 + 2*y**2 - 1", bounds=[[-2, -2], [2, 2]]), 0.1, 1.8),
    "levelset.callable": (quadric, 0.2, 1.8),
    "levelset.grid": (grid, 0.2, 1.8),
    "levelset.dziuk": (make("levelset.dziuk"), 0.1, 1.8),
    "levelset.decotetrahedron": (make("levelset.decotetrahedron"), 0.2, 1.8),
    "levelset.tooth": (make("levelset.tooth"), 0.1, 1.8),
    "levelset.goursat": (make("levelset.goursat"), 0.1, 1.8),
    "parametric.curve": (
        make("parametric.curve", x=["cos(t)", "sin(t)", "0.3*sin(2*t)"], range=TURN, periodic=True),
        0.1,
        1.8,
    ),
    "parametric.helix": (make("parametric.helix"), 0.1, 1.8),
    "parametric.torus_knot": (make("parametric.torus_knot", a=2, b=3), 0.1, 1.8),
    "parametric.planar_curve": (make("parametric.planar_curve"), 0.01, 1.8),
    "parametric.surface": (
        make("parametric.surface", x=["u", "v", "0.3*sin(u)*cos(v)"], u=[-1.5, 1.5], v=[-1, 1]),
        0.2,
        1.8,
    ),
    "parametric.revolution": (
        make("parametric.revolution", profile=["1 + 0.3*cos(t)", "0.6*sin(t)"], range=TURN, periodic=True),
        0.1,
        1.8,
    ),
    "parametric.moebius": (make("parametric.moebius"), 0.1, 1.8),
    "pointcloud.points": (cloud, 0.2, 1.8),
    "union": (dumbbell, 0.2, 1.8),
    "moved": (make("moved", of=ck.source("analytic.torus"), rotation=[0.4, 0.1, 0], scale=2.0), 0.28, 1.8),
    "trimmed": (make("trimmed", of=ck.source("analytic.sphere"), trim="z - 0.6"), 0.2, 1.8),
    "solid": (make("solid", of=ck.source("analytic.circle")), 0.1, 1.8),
}
#: No manifolds to solve on, or (the Klein bottle) one that crosses itself, where the equation is not defined.
OTHERS = {"analytic.point", "points", "cut.plane", "cut.function", "mesh.edge_loop", "mesh.feature_edges"}
OTHERS |= {"parametric.klein"}


def u(x):
    """Data on the cut."""
    return 0.3 + x[:, 0] * x[:, 1] + np.sin(x[:, -1])


def f(x):
    """Right-hand side."""
    return np.cos(x[:, 0]) - x[:, 1]


def scene(surface, problem):
    bounds = np.asarray(surface.bounds)
    normal = np.array([0.83, 0.41, 0.37])[: surface.dim]
    point = bounds.mean(axis=0) + 0.11 * (bounds[1] - bounds[0])
    plane = ck.source("cut.plane", surface=surface, point=point, normal=normal)
    return ck.Scene(surface, problem, [ck.Boundary("cut", plane, both=ck.Dirichlet(u))])


def observed_order(kind, problem):
    maker, coarsest, _ = KINDS[kind]
    surface = maker()
    posed = scene(surface, problem)
    bounds = np.asarray(surface.bounds)
    rng = np.random.default_rng(2)
    points = surface.closest_point(rng.uniform(bounds[0], bounds[1], (1500, surface.dim))).points
    solved = [ck.solve(posed, coarsest / 2**k).evaluate(points) for k in range(3)]
    first, second = (np.sqrt(np.mean((solved[k] - solved[k + 1]) ** 2)) for k in range(2))
    return np.log2(first / second)


@pytest.mark.parametrize("kind", KINDS)
def test_screened_poisson(kind):
    assert observed_order(kind, ck.ScreenedPoisson(f, 1.0)) > KINDS[kind][2]


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_poisson(kind):
    assert observed_order(kind, ck.Poisson(f)) > KINDS[kind][2]


def test_every_installed_manifold_is_listed():
    sources = {
        one.kind
        for one in installed_kinds()
        if hasattr(load(one.kind), "cpmkit_sources") and one.kind in load(one.kind).cpmkit_sources()
    }
    assert sources - set(KINDS) - OTHERS == set()
    assert all(callable(factory(kind)) for kind in KINDS)
