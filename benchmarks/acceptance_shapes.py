"""Rows of benchmarks/acceptance.py on shapes: real meshes, thin limbs, gaps, creases, one shape known in many ways."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from model_problems import order_of
from palm_mesh import FINGER_RADIUS, palm
from scipy.spatial import cKDTree
from test_hard_limbs import PALM, lowest
from test_hard_shapes import (
    KNOWN_SPHERES,
    SPHERE,
    cube,
    lens,
    rotation,
    shifted,
    sphere_points,
    tamarind_error,
    xy,
)

import cpmkit as ck
from cpmkit.studies.studyfile import load_study

Row = Iterator[tuple[str, float, float]]
#: The solution that errors on meshes are measured against has so many times as fine a spacing.
FINER = 4


def rms(off: np.ndarray, exact: np.ndarray) -> float:
    """Return the root mean square in percent of the range."""
    return float(100 * np.sqrt(np.mean(off**2)) / np.ptp(exact))


def meshes() -> Row:
    """Differences from the same form at a quarter of the finer spacing, read as the smooth surface."""
    from problems_of_documentation import STUDIES

    most = {
        "spot": {0.0386: 0.13, 0.0193: 0.04},
        "nefertiti": {0.0177: 0.3},
        "fish": {0.0156: 0.1},
        "mountain": {0.017: 0.1},
    }
    for name, spacings in most.items():
        scene = load_study(STUDIES / f"sheets-{name}.toml").scene
        at = np.random.default_rng(0).permutation(scene.surface.mesh(1.0)[0])[:6000]
        fine = ck.solve(scene, min(spacings) / FINER, form="galerkin").evaluate(at)
        for spacing, limit in spacings.items():
            off = ck.solve(scene, spacing, form="galerkin").evaluate(at) - fine
            yield f"{name}, h = {spacing:g}, rms error, %", rms(off, fine), limit


def thin_limbs() -> Row:
    """The first four eigenvalues other than zero of a palm with fingers few spacings thick, at four positions."""
    vertices, faces = palm()
    source = ck.source("mesh.triangles", vertices=vertices, faces=faces, closest="faceted")
    for thickness, limit in ((2.0, 1.0), (1.5, 2.0), (1.0, 5.0)):
        spacing = 2 * FINGER_RADIUS / thickness
        shifts = np.random.default_rng(0).uniform(0, spacing, (4, 3))
        off = np.mean([lowest(source, spacing, 5, origin=one)[1:] / PALM - 1 for one in shifts], axis=0)
        yield f"fingers {thickness:g} h thick, eigenvalues, %", 100 * np.abs(off).max(), limit


def ring_around_a_limb() -> Row:
    """Two constants on the sides of a ring around a cylinder few spacings thick, at three positions."""
    spacing, angle, z = 0.1, np.linspace(0, 6, 50), np.linspace(-0.95, 0.95, 50)
    for thickness in (1.0, 1.5, 2.0, 2.5):
        radius = 0.5 * thickness * spacing
        ring = ck.source("analytic.circle", radius=radius, normal=[0, 0, 1])
        sides = {"left": ck.Dirichlet(1.0), "right": ck.Dirichlet(0.0)}
        limb = ck.source("analytic.cylinder", radius=radius, length=2.0)
        scene = ck.Scene(limb, ck.Laplace(), [ck.Boundary("ring", ring, **sides)])
        at = np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1)
        off = []
        for shift in np.random.default_rng(0).uniform(0, spacing, (3, 3)):
            solution = ck.solve(scene, spacing, form="galerkin", origin=shift)
            off.append(solution.evaluate(at) - (solution.signed_distance("ring", at) > 0))
        yield f"limb {thickness:g} h thick, largest error", float(np.abs(off).max()), 1e-6


def side_by_side() -> Row:
    """Cylinders with unlike loads, few spacings apart: each keeps its own constant."""
    spacing, radius = 0.1, 0.3
    for gap in (4.0, 2.0, 1.5):
        apart = 2 * radius + gap * spacing
        limbs = [ck.source("analytic.cylinder", radius=radius, length=2.0, center=[x, 0, 0]) for x in (0, apart)]
        sign = lambda x, apart=apart: np.where(x[:, 0] < apart / 2, 1.0, -1.0)  # noqa: E731
        pair = ck.Scene(ck.source("union", members=limbs), ck.ScreenedPoisson(sign))
        solution = ck.solve(pair, spacing, form="galerkin")
        at = solution.discretized.points
        yield f"{gap:g} h apart, largest error", float(np.abs(solution.evaluate(at)[:] - sign(at)).max()), 1e-3


def gaps() -> Row:
    """An arc over a gap of 1.5 spacings, and a zone of a sphere over a slit of 2: u is linear along."""
    spacing = 0.05
    start, end = 0.75 * spacing, 2 * np.pi - 0.75 * spacing
    angle = np.linspace(start, end, 400)
    exact = 1 - 2 * (angle - start) / (end - start)
    arc = ck.source("analytic.arc", start=start, end=end)
    scene = ck.Scene(arc, ck.Laplace(), edge=ck.Dirichlet(lambda x: np.sign(x[:, 1])))
    shifts = np.random.default_rng(0).uniform(0, spacing, (4, 2))
    at = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    off = [ck.solve(scene, spacing, form="galerkin", origin=one).evaluate(at) - exact for one in shifts]
    yield "arc, gap of 1.5 h, largest error", float(np.abs(off).max()), 0.01
    spacing, rng = 0.1, np.random.default_rng(0)
    turn = {"u": [spacing, 2 * np.pi - spacing], "v": [-0.6, 0.6]}
    zone = ck.source("parametric.surface", x=["cos(u)*cos(v)", "sin(u)*cos(v)", "sin(v)"], **turn)

    def linear(x: np.ndarray) -> np.ndarray:
        return np.asarray(1 - (np.arctan2(x[:, 1], x[:, 0]) % (2 * np.pi) - spacing) / (np.pi - spacing))

    u, v = rng.uniform(*turn["u"], 2000), rng.uniform(*turn["v"], 2000)
    at = np.stack([np.cos(u) * np.cos(v), np.sin(u) * np.cos(v), np.sin(v)], axis=1)
    scene = ck.Scene(zone, ck.Laplace(), edge=ck.Dirichlet(linear))
    shifts = rng.uniform(0, spacing, (3, 3))
    off = [ck.solve(scene, spacing, form="galerkin", origin=one).evaluate(at) - linear(at) for one in shifts]
    yield "sphere, slit of 2 h, largest error", float(np.abs(off).max()), 0.02


def creases() -> Row:
    """A turned cube against its exact solution, a lens of two caps against h = 0.02."""
    half, turned, rng = 0.6, rotation(), np.random.default_rng(0)

    def u(x: np.ndarray) -> np.ndarray:
        return np.asarray(np.cos(np.pi * (x @ turned) / half).sum(axis=1))

    def f(x: np.ndarray) -> np.ndarray:
        flat = np.cos(np.pi * (x @ turned) / half)
        own = flat[np.arange(len(x)), np.abs(x @ turned).argmax(axis=1)]
        return np.asarray((1 + (np.pi / half) ** 2) * (flat.sum(axis=1) - own) + own)

    at = rng.uniform(-half, half, (3000, 3))
    at[np.arange(3000), rng.integers(0, 3, 3000)] = half * rng.choice([-1, 1], 3000)
    at = at @ turned.T
    worst = max(rms(one.evaluate(at) - u(at), u(at)) for one in shifted(cube(half, turned), f, 0.1, 3))
    yield "turned cube, h = 0.1, rms error, %", worst, 0.2
    vertices, faces = lens(60, 200)
    source = ck.source("mesh.triangles", vertices=vertices, faces=faces, closest="faceted")
    load = lambda x: xy(x) + x[:, 2] * np.exp(x[:, 0])  # noqa: E731
    fine = ck.solve(ck.Scene(source, ck.ScreenedPoisson(load)), 0.02, form="galerkin").evaluate(vertices)
    worst = max(rms(one.evaluate(vertices) - fine, fine) for one in shifted(source, load, 0.05, 2))
    yield "lens, h = 0.05, rms error, %", worst, 0.05


def ways_to_know_a_sphere() -> Row:
    """One sphere in five ways, u = x y, h = 0.1."""
    at = sphere_points(2000)
    for way, make in KNOWN_SPHERES.items():
        source = make()
        (solution,) = shifted(source, lambda x: 7 * xy(x), 0.1, 1)
        off = solution.evaluate(at) - xy(at)
        yield f"{way}, rms error", float(np.sqrt(np.mean(off**2))), 1.5e-4
        yield f"{way}, largest error", float(np.abs(off).max()), 1.5e-4


def moebius() -> Row:
    """Seven eigenvalues of a Moebius strip at h = 0.1 against h = 0.033."""
    strip = ck.source("parametric.moebius")
    fine = lowest(strip, 0.0333, 8)[1:]
    yield "seven eigenvalues, largest relative error", float(np.abs(lowest(strip, 0.1, 8)[1:] / fine - 1).max()), 5e-4


def curves_in_space() -> Row:
    """U = cos(w s) with two waves along a trefoil and a helix, h = 0.05, four positions."""
    trefoil = ck.source(
        "parametric.curve",
        x=["sin(t) + 2*sin(2*t)", "cos(t) - 2*cos(2*t)", "-sin(3*t)"],
        range=[0, 2 * np.pi],
        periodic=True,
    )
    places: dict[str, tuple[object, Callable[[np.ndarray], list[np.ndarray]], float]] = {
        "trefoil": (
            trefoil,
            lambda t: [np.sin(t) + 2 * np.sin(2 * t), np.cos(t) - 2 * np.cos(2 * t), -np.sin(3 * t)],
            2 * np.pi,
        ),
        "helix": (ck.source("parametric.helix"), lambda t: [np.cos(t), np.sin(t), t / (2 * np.pi)], 4 * np.pi),
    }
    for name, (source, place, end) in places.items():
        x = np.stack(place(np.linspace(0, end, 40_001)), axis=1)
        way = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(x, axis=0), axis=1))])
        wave, tree = 4 * np.pi / way[-1], cKDTree(x)
        u = lambda at, wave=wave, way=way, tree=tree: np.cos(wave * way[tree.query(at)[1]])  # noqa: E731
        f = lambda at, wave=wave, u=u: (1 + wave**2) * u(at)  # noqa: E731
        off = [one.evaluate(x[::20]) - u(x[::20]) for one in shifted(source, f, 0.05, 4)]
        yield f"{name}, largest error of the range", float(np.abs(off).max() / 2), 1e-5


def tamarind() -> Row:
    """The level set of deal.II's step-90, L2 errors."""
    for spacing, most, limit in ((0.1, 7500, 2.5e-3), (0.05, 30_000, 5e-4)):
        unknowns, error = tamarind_error(spacing)
        yield f"h = {spacing:g}, unknowns", unknowns, most
        yield f"h = {spacing:g}, L2 error", error, limit


def spheres_order() -> Row:
    """How fast the error on a sphere falls: the order that is lacking to 2.7."""
    spacings, at = [0.2, 0.1, 0.05], sphere_points(2000)
    found = [
        np.sqrt(np.mean([(one.evaluate(at) - xy(at)) ** 2 for one in shifted(SPHERE, lambda x: 7 * xy(x), h, 2)]))
        for h in spacings
    ]
    yield "order below 3 by", 3 - order_of(spacings, found), 0.3


ROWS = {
    "meshes": meshes,
    "thin-limbs": thin_limbs,
    "ring": ring_around_a_limb,
    "side-by-side": side_by_side,
    "gaps": gaps,
    "creases": creases,
    "sphere": ways_to_know_a_sphere,
    "order": spheres_order,
    "moebius": moebius,
    "curves": curves_in_space,
    "tamarind": tamarind,
}
