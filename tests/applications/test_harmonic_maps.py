"""Harmonic maps: energy, degree and landmarks on spheres, speed along curves, textures, both methods, refusals."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import cpmkit as ck
from cpmkit.applications import harmonic_flows, harmonic_map

SPHERE = ck.source("analytic.sphere")
#: Of maps of degree one between unit spheres.
LEAST_ENERGY = 4 * np.pi
RING = ck.source("analytic.circle", normal=[0.3, 0.2, 1.0])


def _noisy(points: np.ndarray) -> np.ndarray:
    return points + 0.15 * np.random.default_rng(0).normal(size=points.shape)


def _conformal(points: np.ndarray) -> np.ndarray:
    """Return what the plane's z -> 1.2 z does through the stereographic projection; a harmonic map."""
    x, y, z = points.T
    polar, turn = 2 * np.arctan2(1.2 * np.sqrt(np.clip(1 - z, 0, 2)), np.sqrt(np.clip(1 + z, 0, 2))), np.arctan2(y, x)
    return np.stack([np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar)], axis=1)


@pytest.mark.parametrize("spacing", [0.25, pytest.param(0.1, marks=pytest.mark.slow)])
def test_a_noisy_map_relaxes_to_the_least_energy_of_its_degree(spacing: float) -> None:
    """Asked for: within 3e-4 of 4 pi in at most 15 steps from noise of .15, energy never rising, degree kept."""
    found = harmonic_map(SPHERE, SPHERE, initial=_noisy, spacing=spacing)
    assert found.at_rest
    assert len(found.energy) - 1 <= 15
    assert abs(found.energy[-1] / LEAST_ENERGY - 1) < 3e-4
    assert np.diff(found.energy).max() <= 1e-6 * found.energy[-1]
    assert found.degree == 1


@pytest.mark.parametrize("spacings", [(0.5, 0.35, 0.25), pytest.param((0.4, 0.2, 0.1), marks=pytest.mark.slow)])
@pytest.mark.filterwarnings("ignore:The map did not come to rest")
def test_landmarks_are_met_to_second_order(spacings: tuple[float, ...]) -> None:
    on = ck.boundary_points(RING, SPHERE, 0.05).points
    off = []
    for spacing in spacings:
        found = harmonic_map(SPHERE, SPHERE, landmarks=[(RING, _conformal)], spacing=spacing, most_steps=3)
        sides = [found.evaluate(on, side) for side in ("left", "right")]
        off.append(max(np.linalg.norm(one - _conformal(on), axis=1).max() for one in sides))
    assert np.polyfit(np.log(spacings), np.log(off), 1)[0] > 2


def test_a_conformal_map_comes_to_rest_where_it_is() -> None:
    found = harmonic_map(SPHERE, SPHERE, initial=_conformal, spacing=0.25)
    at = SPHERE.mesh(0.3)[0]
    assert np.linalg.norm(found.evaluate(at) - _conformal(at), axis=1).max() < 5e-3
    np.testing.assert_allclose(np.linalg.norm(found.evaluate(at), axis=1), 1.0, atol=1e-9)


def test_along_curves_harmonic_maps_have_one_speed() -> None:
    circle = ck.source("analytic.circle")
    ellipse = ck.source("parametric.curve", x=["1.5*cos(t)", "sin(t)"], range=[0, 2 * np.pi], periodic=True)
    found = harmonic_map(circle, ellipse, initial=lambda x: x * [1.5, 1.0], spacing=0.1, rest=1e-8)
    angles = np.linspace(0, 2 * np.pi, 60)
    images = found.evaluate(np.stack([np.cos(angles), np.sin(angles)], axis=1))
    steps = np.linalg.norm(np.diff(images, axis=0), axis=1)
    assert np.ptp(steps) < 5e-3 * steps.mean()


@pytest.mark.parametrize(
    ("turns", "degree"),
    [([1, 1, 1], 1), ([1, 1, -1], -1), ([-1, -1, 1], 1)],
)
def test_the_degree_of_reflections(turns: list[int], degree: int) -> None:
    assert _started_at(lambda x: x * turns).degree == degree


@pytest.mark.filterwarnings("ignore:The map did not come to rest")
def test_the_degree_of_a_sphere_wrapped_twice_is_two() -> None:
    def wrapped(points: np.ndarray) -> np.ndarray:
        radius, turn = np.hypot(points[:, 0], points[:, 1]), np.arctan2(points[:, 1], points[:, 0])
        return np.stack([radius * np.cos(2 * turn), radius * np.sin(2 * turn), points[:, 2]], axis=1)

    assert _started_at(wrapped).degree == 2


def _started_at(initial: Any, surface: Any = SPHERE) -> Any:
    """Return a map after one step from the map ``initial`` to the sphere."""
    return harmonic_map(surface, SPHERE, initial=initial, spacing=0.2, most_steps=1)


def test_textures_are_pulled_back_from_vertices_and_functions() -> None:
    vertices, faces = SPHERE.mesh(0.3)
    mesh = ck.source("mesh.triangles", vertices=vertices, faces=faces)
    found = harmonic_map(SPHERE, mesh, spacing=0.4, most_steps=3)
    at = np.array([[0.6, 0, 0.8], [0, -1, 0]])
    np.testing.assert_allclose(found.pull_back(vertices[:, 2])(at), at[:, 2], atol=0.03)
    np.testing.assert_allclose(found.pull_back(lambda x: x[:, 0] ** 2)(at), at[:, 0] ** 2, atol=0.03)


def test_the_papers_explicit_steps_go_the_same_way() -> None:
    found = harmonic_map(SPHERE, SPHERE, initial=_noisy, spacing=0.25, method="explicit", most_steps=200)
    assert found.at_rest
    assert np.diff(found.energy).max() < 0
    assert abs(found.energy[-1] / LEAST_ENERGY - 1) < 1e-3
    with pytest.warns(ck.CpmkitWarning, match="did not come to rest within 20 steps"):
        harmonic_map(SPHERE, SPHERE, initial=_noisy, spacing=0.25, method="explicit", most_steps=20)


def test_explicit_steps_that_raise_the_energy_are_not_at_rest(monkeypatch: pytest.MonkeyPatch) -> None:
    rising = iter(range(1, 10))
    monkeypatch.setattr(harmonic_flows, "_dirichlet_energy", lambda _: float(next(rising)))
    with pytest.warns(ck.CpmkitWarning, match="did not come to rest"):
        found = harmonic_map(SPHERE, SPHERE, initial=_noisy, spacing=0.5, method="explicit", most_steps=60)
    assert not found.at_rest


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"method": "newton"}, "method must be"),
        ({"initial": "identity"}, "initial must be"),
        ({"landmarks": [RING]}, "pairs"),
        ({"landmarks": [(RING, [0, 0, 1])]}, "function of its points"),
        ({"landmarks": [([[0, 0, 1], [0, 1, 0]], [[0, 0, 1]])]}, "as many points"),
        ({"method": "explicit", "step": 1.0}, "at most"),
        ({"rest": 0.0}, "rest"),
    ],
)
def test_bad_arguments_are_reported(given: dict[str, Any], words: str) -> None:
    with pytest.raises(ck.InputError, match=words):
        harmonic_map(SPHERE, SPHERE, spacing=0.5, **given)


def test_a_degree_of_surfaces_without_closed_meshes_is_refused() -> None:
    found = _started_at("nearest", ck.source("parametric.moebius"))
    with pytest.raises(ck.InputError, match="closed oriented"):
        _ = found.degree
