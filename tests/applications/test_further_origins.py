"""Distances from further origins on one prepared scene: the same as from fresh ones, and little work."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np
import pytest

import cpmkit as ck
import cpmkit.forms.galerkin.space.energy as energy
import cpmkit.linear.direct as factorization
import cpmkit.linear.multigrid.solver as multigrid
from cpmkit.applications import geodesic_distance

SPHERE = ck.source("analytic.sphere")


@pytest.mark.parametrize("method", ["heat", "transport"])
def test_a_further_origin_measures_as_a_fresh_scene_does(method: str) -> None:
    prepared = ck.prepare(ck.Scene(SPHERE, ck.Poisson(0.0)), 0.4, form="galerkin")
    points = SPHERE.closest_point(np.random.default_rng(0).normal(size=(200, 3))).points
    for origin in ([1, 0, 0], [0, 0.6, 0.8], [1, 0, 0]):
        further = geodesic_distance(prepared, origin, method=method).evaluate(points)
        fresh = geodesic_distance(SPHERE, origin, spacing=0.4, method=method).evaluate(points)
        np.testing.assert_allclose(further, fresh, atol=1e-8)


def test_a_further_origin_by_heat_makes_no_factors_and_goes_through_the_samples_four_times(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Values and slopes of the heat, the load of its directions, and the places of all samples once."""
    done: Counter[str] = Counter()

    def counted(where: Any, name: str, size: Any = lambda _: True) -> None:
        plain = getattr(where, name)

        def call(*arguments: Any, **named: Any) -> Any:
            found = plain(*arguments, **named)
            done[name] += bool(size(found))
            return found

        monkeypatch.setattr(where, name, call)

    prepared = ck.prepare(ck.Scene(SPHERE, ck.Poisson(0.0)), 0.3, form="galerkin")
    count = len(prepared.points)
    geodesic_distance(prepared, [1, 0, 0], method="heat")
    counted(factorization, "factorize_matrix")
    counted(energy, "values_at_samples", lambda found: len(found) >= count)
    counted(energy, "gradients_at_samples")
    counted(energy, "gradient_load")
    for name in ("points_at", "normals_at"):
        counted(type(prepared.discretized.sampled.samples), name, lambda found: len(found) >= count)
    geodesic_distance(prepared, [0, 1, 0], method="heat")
    assert +done == Counter(values_at_samples=1, gradients_at_samples=1, gradient_load=1, points_at=1)


def test_heat_is_read_as_exact_also_if_the_scene_was_prepared_with_the_direct_solver() -> None:
    """At this spacing heat falls below the noise of an iterative solver within half of the sphere."""
    found = []
    for solver in ({}, {"solver": "direct", "solver_tolerance": 1e-7}):
        prepared = ck.prepare(ck.Scene(SPHERE, ck.Poisson(0.0)), 0.15, form="galerkin", **solver)
        found.append(geodesic_distance(prepared, [1, 0, 0], method="heat").evaluate([[-0.8, 0.6, 0], [0, 0, 1]]))
    np.testing.assert_allclose(*found, atol=1e-8)


def test_the_rounds_of_transport_share_one_preconditioner(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[Any] = []
    plain = multigrid.build_schwarz_cycle

    def counted(*arguments: Any) -> Any:
        made.append(plain(*arguments))
        return made[-1]

    monkeypatch.setattr(multigrid, "build_schwarz_cycle", counted)
    prepared = ck.prepare(ck.Scene(SPHERE, ck.Poisson(0.0)), 0.15, form="galerkin")
    distance = geodesic_distance(prepared, [0, 0, 1], rounds=3)
    assert len(made) == 1
    assert 0 < distance.solution.report.iterations < 20
    geodesic_distance(prepared, [1, 0, 0], rounds=1)
    assert len(made) == 2
