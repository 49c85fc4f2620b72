"""Transport of vectors from points and the logarithmic map, against the sphere's; pictures of fields."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import cpmkit as ck
from cpmkit.applications import logarithmic_map, transport_vector, vector_field

SPHERE = ck.source("analytic.sphere")
POLAR, TURN = np.random.default_rng(0).uniform([[0.05], [0]], [[2.4], [2 * np.pi]], (2, 500))
POINTS = np.stack([np.sin(POLAR) * np.cos(TURN), np.sin(POLAR) * np.sin(TURN), np.cos(POLAR)], axis=1)
#: What comes from the north pole's first axis along meridians.
AROUND = np.stack([-np.sin(TURN), np.cos(TURN), 0 * TURN], axis=1)
EXACT = np.cos(TURN)[:, None] * np.cross(AROUND, POINTS) - np.sin(TURN)[:, None] * AROUND


def _order(spacings: tuple[float, ...], errors: list[float]) -> float:
    return float(np.polyfit(np.log(spacings), np.log(errors), 1)[0])


@pytest.mark.parametrize("spacings", [(0.4, 0.28), pytest.param((0.4, 0.2, 0.1), marks=pytest.mark.slow)])
def test_logarithms_and_transport_are_exact_to_second_order_on_the_sphere(spacings: tuple[float, ...]) -> None:
    logarithms = POLAR[:, None] * np.stack([np.cos(TURN), np.sin(TURN)], axis=1)
    off, turned = [], []
    for spacing in spacings:
        found = logarithmic_map(SPHERE, [0, 0, 1], axis=[1, 0, 0], spacing=spacing, method="heat")
        off.append(float(np.linalg.norm(found.evaluate(POINTS) - logarithms, axis=1).mean()))
        moved = found.transported_axes[0].evaluate(POINTS, normalized=True)
        turned.append(float(np.linalg.norm(moved - EXACT, axis=1).mean()))
    assert off[0] < 0.1
    assert _order(spacings, off) > 1.6
    assert turned[0] < 0.05
    assert _order(spacings, turned) > 1.3


def test_lengths_are_kept_and_mixed_half_way_between_two_points() -> None:
    alone = transport_vector(SPHERE, [0, 0, 1], [2, 0, 0], spacing=0.4)
    np.testing.assert_allclose(np.linalg.norm(alone.evaluate(POINTS[:50]), axis=1), 2, rtol=1e-6)
    np.testing.assert_allclose(alone.evaluate([[0, 0, 1.0]], normalized=True), [[1, 0, 0]], atol=0.02)
    both = transport_vector(SPHERE, [[0, 0, 1], [0, 0, -1]], [[2, 0, 0], [0, 3, 0]], spacing=0.4)
    lengths = np.linalg.norm(both.evaluate([[0.1, 0, 0.99], [1, 0, 0], [0.1, 0, -0.99]]), axis=1)
    np.testing.assert_allclose(lengths[1], 2.5, rtol=0.02)
    assert lengths[0] < lengths[1] < lengths[2]


@pytest.mark.parametrize(
    ("function", "given", "words"),
    [
        (transport_vector, ([0, 0, 1], [0, 0, 1]), "nor normal to the surface"),
        (logarithmic_map, ([0, 0, 1, 2],), "point"),
    ],
)
def test_bad_vectors_are_reported(function: Any, given: tuple[Any, ...], words: str) -> None:
    with pytest.raises(ck.InputError, match=words):
        function(SPHERE, *given, spacing=0.5)


def test_arrows_lie_beside_the_surface() -> None:
    field = vector_field(SPHERE, [(ck.source("analytic.circle", normal=[0, 0, 1]), "tangent")], spacing=0.4)
    plain, mesh = field.solution.display_mesh(), field.drawable(length=0.1).display_mesh()
    corners = mesh.points[len(plain.points) :]
    np.testing.assert_allclose(np.abs(np.linalg.norm(corners, axis=1) - 1), 0.008, atol=1e-4)
    assert len(corners)
    assert mesh.cells.max() < len(mesh.points) == len(mesh.normals)


def test_a_field_is_drawn(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    equator = ck.source("analytic.circle", normal=[0, 0, 1])
    field = vector_field(SPHERE, [(equator, "tangent")], spacing=0.4)
    field.picture(tmp_path / "field.png", width=120)
    assert (tmp_path / "field.png").stat().st_size > 500
