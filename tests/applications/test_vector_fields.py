"""Fields of tangential vectors: exact problems of both transports, singularities, sides, refusals."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import cpmkit as ck
from cpmkit.applications import vector_field
from cpmkit.applications.vector_fields import singularities

SPHERE = ck.source("analytic.sphere")
EQUATOR = ck.source("analytic.circle", normal=[0, 0, 1])
DOUBLE_TORUS = ck.source(
    "levelset.expression",
    phi="(x*(x-1)**2*(x-2)+y**2)**2+z**2-0.03",
    bounds=[[-0.4, -0.9, -0.4], [2.4, 0.9, 0.4]],
)
#: Polar angles of two circles on the sphere, and places between them.
NORTH, SOUTH = 0.7, 2.0
ANGLES, TURNS = np.random.default_rng(0).uniform([[NORTH + 0.02], [0]], [[SOUTH - 0.02], [2 * np.pi]], (2, 2000))
POINTS = np.stack([np.sin(ANGLES) * np.cos(TURNS), np.sin(ANGLES) * np.sin(TURNS), np.cos(ANGLES)], axis=1)


def _meridional(points: np.ndarray) -> np.ndarray:
    return np.cross(_zonal(points), points)


def _zonal(points: np.ndarray) -> np.ndarray:
    around = np.stack([-points[:, 1], points[:, 0], 0 * points[:, 0]], axis=1)
    return around / np.linalg.norm(around, axis=1, keepdims=True)


def _pair(theta: Any, transport: str) -> np.ndarray:
    """Return two solutions of f'' + cot f' - k f = 0, k = cot^2 of the connection and 1 / sin^2 of the coordinates."""
    if transport == "paper":
        return np.array([np.tan(theta / 2), 1 / np.tan(theta / 2)])
    from scipy.integrate import solve_ivp

    def slope(t: float, f: np.ndarray) -> list[float]:
        return [f[1], -f[1] / np.tan(t) + f[0] / np.tan(t) ** 2]

    runs = [solve_ivp(slope, (NORTH, SOUTH), one, dense_output=True, rtol=1e-10, atol=1e-12) for one in np.eye(2)]
    return np.array([run.sol(theta)[0] for run in runs])


def _exact(transport: str) -> np.ndarray:
    """Return the field with e_theta on the northern circle and e_phi on the southern."""
    ends = np.array([_pair(end, transport) for end in (NORTH, SOUTH)])
    along, around = (np.linalg.solve(ends, one) @ _pair(ANGLES, transport) for one in np.eye(2))
    return along[:, None] * _meridional(POINTS) + around[:, None] * _zonal(POINTS)


@pytest.mark.parametrize("transport", ["parallel", "paper"])
@pytest.mark.parametrize(
    ("spacings", "most"), [((0.5, 0.4, 0.25), 0.06), pytest.param((0.4, 0.2, 0.1), 0.01, marks=pytest.mark.slow)]
)
def test_directions_between_two_circles(transport: str, spacings: tuple[float, ...], most: float) -> None:
    """Asked for: .15 degrees at .1, falling with the spacing."""
    circles = [
        ck.source("analytic.circle", center=[0, 0, np.cos(end)], radius=np.sin(end), normal=[0, 0, 1])
        for end in (NORTH, SOUTH)
    ]
    exact, means = _exact(transport), []
    exact /= np.linalg.norm(exact, axis=1, keepdims=True)
    for spacing in spacings:
        given = [(circles[0], _meridional), (circles[1], "tangent")]
        found = vector_field(SPHERE, given, spacing=spacing, transport=transport).evaluate(POINTS)
        means.append(np.degrees(np.arccos(np.clip(np.sum(found * exact, axis=1), -1, 1))).mean())
        assert np.abs(np.sum(found * POINTS, axis=1)).max() < 1e-9
    assert means[-1] < most
    for k in (0, 1):
        assert np.log(means[k] / means[k + 1]) / np.log(spacings[k] / spacings[k + 1]) > 1.5


@pytest.mark.parametrize(("kind", "euler"), [("sphere", 2), ("torus", 0)])
def test_indices_sum_to_the_euler_characteristic_of_any_field(kind: str, euler: int) -> None:
    vertices, faces = ck.source(f"analytic.{kind}").mesh(0.15)
    for seed in range(5):
        rng = np.random.default_rng(seed)
        vectors = rng.normal(size=3) + vertices @ rng.normal(size=(3, 3))
        assert sum(one.index for one in singularities(vertices, faces, vectors)) == euler


@pytest.mark.parametrize("seed", range(4))
def test_indices_on_a_double_torus_sum_to_minus_two(seed: int) -> None:
    """Of a mesh so coarse that some slivers face their own corners' normals."""
    vertices, faces = DOUBLE_TORUS.mesh(0.12)
    rng = np.random.default_rng(seed)
    vectors = rng.normal(size=3) + vertices @ rng.normal(size=(3, 3))
    assert sum(one.index for one in singularities(vertices, faces, vectors)) == -2


def test_a_field_along_a_moebius_strip_has_no_singularity_and_a_vortex_has_one() -> None:
    vertices, faces = ck.source("parametric.moebius").mesh(0.1)
    assert singularities(vertices, faces, _zonal(vertices)) == []
    centre = vertices[faces[len(faces) // 2]].mean(axis=0)
    found = singularities(vertices, faces, vertices - centre)
    near = [one for one in found if np.linalg.norm(one.place - centre) < 0.1]
    assert [abs(one.index) for one in near] == [1]


def test_singularities_of_a_field_along_the_equator_are_at_the_poles() -> None:
    found = vector_field(SPHERE, [(EQUATOR, "tangent")], spacing=0.4).singularities
    assert sum(one.index for one in found) == 2
    assert all(abs(one.place[2]) > 0.9 for one in found)


def test_a_curve_may_turn_the_field_on_its_two_sides() -> None:
    field = vector_field(SPHERE, [(EQUATOR, {"left": "tangent", "right": "backwards"})], spacing=0.3)
    above, below = field.evaluate([[0.8, 0, 0.6], [0.8, 0, -0.6]])
    np.testing.assert_allclose(above, [0, 1, 0], atol=1e-6)
    np.testing.assert_allclose(below, [0, -1, 0], atol=1e-6)


def test_a_direction_at_a_point_is_kept_there() -> None:
    field = vector_field(SPHERE, [([[1, 0, 0], [0, 1, 0]], [0, 0.3, 1.0]), ([0, 0, 1], [1, 0, 0])], spacing=0.4)
    found = field.evaluate([[1.0, 0, 0], [0, 1, 0], [0, 0, 1]])
    exact = np.array([[0, 0.3, 1], [0, 0, 1], [1, 0, 0]])
    np.testing.assert_allclose(found, exact / np.linalg.norm(exact, axis=1, keepdims=True), atol=0.02)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ([], "at least"),
        ([(EQUATOR, "up")], "direction along a curve"),
        ([(EQUATOR, {"left": "tangent"})], "left and right"),
        ([([0, 0, 1], [0, 0, 1])], "normal to the surface"),
        ([([1.0, 0.7, 0.3], [1.0, 0.7, 0.3])], "normal to the surface"),
        ([EQUATOR], "pairs"),
        ([(EQUATOR, [1.0, 0.0])], "direction along a curve"),
        ([(ck.source("analytic.point", at=[0, 0, 1]), [1, 0, 0])], "points must be numbers"),
        ([([[0, 0, 1], [1, 0, 0]], np.eye(3))], "2 points need one vector or 2, got 3"),
    ],
)
def test_bad_directions_are_reported(given: Any, words: str) -> None:
    with pytest.raises(ck.InputError, match=words):
        vector_field(SPHERE, given, spacing=0.3)


def test_an_unknown_transport_is_reported() -> None:
    with pytest.raises(ck.InputError, match="transport must be"):
        vector_field(SPHERE, [(EQUATOR, "tangent")], spacing=0.3, transport="lie")
