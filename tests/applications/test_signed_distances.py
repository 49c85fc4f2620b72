"""Signed distance: closed and broken curves of sphere and torus, a ring round a real mesh, sides, what is refused."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import cpmkit as ck
from cpmkit.applications import signed_distance
from cpmkit.preparing import Prepared

SPHERE = ck.source("analytic.sphere")
HEIGHT = 0.3
RADIUS = np.sqrt(1 - HEIGHT**2)
LATITUDE = ck.source("analytic.circle", center=[0, 0, HEIGHT], radius=RADIUS, normal=[0, 0, 1])
POINTS = np.random.default_rng(0).normal(size=(2000, 3))
POINTS /= np.linalg.norm(POINTS, axis=1, keepdims=True)
EXACT = np.arcsin(POINTS[:, 2]) - np.arcsin(HEIGHT)


@cache
def _sphere(spacing: float) -> Prepared:
    return ck.prepare(ck.Scene(SPHERE, ck.Poisson(0.0)), spacing, form="galerkin")


def _share(found: np.ndarray, exact: np.ndarray) -> float:
    """Return the rms of the error over the mean distance."""
    return float(np.sqrt(np.mean((found - exact) ** 2)) / np.abs(exact).mean())


def _arcs(share: float) -> list[ck.ClosestPointSource]:
    """Return three arcs that are a share of the latitude circle."""
    found = []
    for begin in (0, 2 * np.pi / 3, 4 * np.pi / 3):
        angle = begin + np.linspace(0, 2 * np.pi / 3 * share, 101)
        points = np.stack([RADIUS * np.cos(angle), RADIUS * np.sin(angle), np.full_like(angle, HEIGHT)], axis=1)
        found.append(ck.source("mesh.polyline", points=points))
    return found


@pytest.mark.parametrize(("method", "most"), [("heat", 4e-3), ("transport", 2.5e-2)])
def test_a_circle_of_a_sphere_at_its_order(method: str, most: float) -> None:
    coarse, fine = (
        _share(signed_distance(_sphere(h), LATITUDE, method=method).evaluate(POINTS), EXACT) for h in (0.5, 0.25)
    )
    assert fine < most
    assert np.log2(coarse / fine) > 1.5


def test_a_broken_circle_has_two_sides_and_goes_on_through_its_gaps() -> None:
    """As gaps close it becomes the closed circle's; they are 60 and 12 degrees of longitude."""
    errors = []
    for share in (0.5, 0.9):
        distance = signed_distance(_sphere(0.2), _arcs(share))
        found = distance.evaluate(POINTS)
        away = np.abs(EXACT) > 0.4
        assert (np.sign(found) == np.sign(EXACT))[away].all()
        errors.append(_share(found, EXACT))
    assert errors[1] < 2e-2
    assert errors[1] < 0.5 * errors[0]


def test_a_broken_circle_as_by_the_signed_heat_method_on_a_mesh() -> None:
    """Both methods close gaps alike: nearer to each other than the broken circle's distance is to the whole one's."""
    potpourri3d = pytest.importorskip("potpourri3d")
    rings = 40  # a mesh with a row of vertices on the latitude circle
    vertices, faces, row = _sphere_of_rings(rings)
    count = len(row)
    curves = [[(int(one), []) for one in row[begin : begin + count // 12 + 1]] for begin in range(0, count, count // 3)]
    theirs = potpourri3d.MeshSignedHeatSolver(vertices, faces).compute_distance(curves, [True] * 3)
    theirs = theirs * np.sign(theirs @ vertices[:, 2])
    ours = signed_distance(_sphere(0.2), _arcs(0.25), method="heat").evaluate(vertices)
    whole = np.arcsin(np.clip(vertices[:, 2], -1, 1)) - np.arcsin(HEIGHT)
    assert _share(ours, theirs) < 0.5 * _share(whole, theirs)


def _sphere_of_rings(rings: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a mesh of the unit sphere with poles, and its vertices on the latitude circle in order."""
    up = np.linspace(np.arcsin(HEIGHT), np.pi / 2, rings // 2 + 1)[:-1]
    down = np.linspace(-np.pi / 2, np.arcsin(HEIGHT), rings // 2 + 1)[1:-1]
    latitudes, around = np.concatenate([down, up]), 3 * rings
    angle = 2 * np.pi * np.arange(around) / around
    place, turn = (one.ravel() for one in np.meshgrid(latitudes, angle, indexing="ij"))
    body = np.stack([np.cos(place) * np.cos(turn), np.cos(place) * np.sin(turn), np.sin(place)], axis=1)
    vertices = np.vstack([body, [[0, 0, -1], [0, 0, 1]]])
    at = np.arange(len(body)).reshape(len(latitudes), around)
    after = np.roll(at, -1, axis=1)
    a, b, c, d = (one.ravel() for one in (at[:-1], after[:-1], after[1:], at[1:]))
    south, north = np.full(around, len(body)), np.full(around, len(body) + 1)
    corners = [(a, b, c), (a, c, d), (after[0], at[0], south), (at[-1], after[-1], north)]
    return vertices, np.concatenate([np.stack(one, axis=1) for one in corners]), at[len(down)]


def test_two_circles_of_a_torus_part_its_outside_from_its_inside() -> None:
    torus = ck.source("analytic.torus", major=1.0, minor=0.4)
    top = ck.source("analytic.circle", center=[0, 0, 0.4], normal=[0, 0, 1])
    bottom = ck.source("analytic.circle", center=[0, 0, -0.4], normal=[0, 0, -1])
    around, along = np.random.default_rng(1).uniform(-np.pi, np.pi, (2, 1000))
    ring = 1 + 0.4 * np.cos(around)
    points = np.stack([ring * np.cos(along), ring * np.sin(along), 0.4 * np.sin(around)], axis=1)
    distance = signed_distance(torus, [top, bottom], spacing=0.25, method="heat")
    exact = 0.4 * (np.abs(around) - np.pi / 2)  # left of both is the inner half
    found = distance.evaluate(points)
    assert (np.sign(found) == np.sign(exact))[np.abs(exact) > 0.05].all()
    assert _share(found, exact) < 6e-2


def test_curves_that_part_no_left_from_a_right_are_reported() -> None:
    lower = ck.source("analytic.circle", center=[0, 0, -HEIGHT], radius=RADIUS, normal=[0, 0, 1])
    with pytest.raises(ck.SceneError, match="do not separate one left from one right"):
        signed_distance(_sphere(0.4), [LATITUDE, lower], method="heat")


def test_refusals() -> None:
    with pytest.raises(ck.InputError, match="points have none"):
        signed_distance(SPHERE, ck.source("analytic.point", at=[0, 0, 1]), spacing=0.4)
    with pytest.raises(ck.InputError, match="surfaces in space"):
        signed_distance(ck.source("analytic.circle"), ck.source("analytic.point", at=[1, 0]), spacing=0.4)
    with pytest.raises(ck.InputError, match="method must be"):
        signed_distance(SPHERE, LATITUDE, spacing=0.4, method="fast")
