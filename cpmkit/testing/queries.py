"""The queries on which the laws are checked, drawn by hypothesis around a source's bounds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from cpmkit.protocols import ClosestPoints, Floats
from cpmkit.testing.cases import ConformanceCase

#: Round-off that is allowed, relative to the largest coordinate that takes part.
ROUND_OFF_SHARE = 1e-12


@dataclass(frozen=True, eq=False)
class Subject:
    """A source under test and the length that everything about it is measured in.

    Attributes
    ----------
    case : ConformanceCase
        Where it comes from.
    source : ClosestPointSource
        What ``case.make`` returned.
    centre : (d,) float64
        Centre of its bounds.
    size : float
        Diagonal of its bounds; of a single point, its largest coordinate, or 1 at the origin.
    answers : dict
        What the source has answered to which queries.
    """

    case: ConformanceCase
    source: Any
    centre: Floats
    size: float
    answers: dict[bytes, ClosestPoints] = field(default_factory=dict)

    def round_off(self, x: Floats) -> Floats:
        """Return (n,) what rounding may cost at the queries ``x``."""
        largest = np.abs(x).max(axis=1) + np.abs(self.source.bounds).max() + self.size
        allowed: Floats = ROUND_OFF_SHARE * largest
        return allowed

    def feet(self, x: Floats) -> ClosestPoints:
        """Return the closest points of ``x``, asked once for all laws that only read them."""
        key = x.tobytes()
        if key not in self.answers:
            self.answers[key] = self.source.closest_point(x.copy())
        return self.answers[key]

    def ask_together(self, batches: Sequence[Floats]) -> None:
        """Ask all batches at once, which is quicker; that no answer depends on its batch is a law of its own."""
        rows = np.split(np.arange(sum(map(len, batches))), np.cumsum([len(x) for x in batches])[:-1])
        together = np.concatenate(batches)
        self.answers[together.tobytes()] = feet = self.source.closest_point(together.copy())
        self.answers.update({x.tobytes(): feet.take(chosen) for x, chosen in zip(batches, rows, strict=True)})

    def known_points(self, count: int = 256) -> Floats | None:
        """Return points (count, d) of the manifold that the case itself supplies."""
        return None if self.case.samples is None else self.case.samples(np.random.default_rng(0), count)


@lru_cache(maxsize=1)
def subject(case: ConformanceCase) -> Subject:
    """Make the source of a case: one for all laws, which follow each other, for it is a value."""
    source = case.make()
    lower, upper = np.asarray(source.bounds, dtype=np.float64)
    diagonal = float(np.linalg.norm(upper - lower))
    size = diagonal or float(np.abs(lower).max()) or 1.0
    return Subject(case, source, 0.5 * (lower + upper), size)


def for_queries(
    subject: Subject, hold: Callable[[Floats], None], within_radius: bool = False, together: bool = False
) -> None:
    """Call ``hold`` with batches of queries (n, d), the same in every run; a failing batch is made small.

    Parameters
    ----------
    subject : Subject
        Around which the queries lie: near its bounds, far out, and on it.
    hold : callable
        Raises AssertionError if the law is broken.
    within_radius : bool
        Draw queries only up to the case's ``radius`` from the manifold, if it has one.
    together : bool
        Call ``hold`` once with the queries of all batches: of a law of each row, or of each pair, it asks no less.
    """
    near = within_radius and subject.case.radius is not None
    try:
        batches = _batches(subject, near)
        for x in [np.concatenate(batches)] if together else batches:
            hold(x.copy())
    except Exception as failure:
        _generate(subject, near, hold)  # fails on the same batches, and shows a small one
        raise failure


@lru_cache(maxsize=2)
def _batches(subject: Subject, near: bool) -> tuple[Floats, ...]:
    """Return what hypothesis draws for a law that holds: to draw and to ask is dear, and is done once."""
    drawn: list[Floats] = []
    _generate(subject, near, drawn.append)
    subject.ask_together(drawn)
    return tuple(drawn)


def _generate(subject: Subject, near: bool, hold: Callable[[Floats], None]) -> None:
    draws = _anywhere(subject) if subject.case.radius is None or not near else _tube(subject, subject.case.radius)

    @settings(
        max_examples=20,
        derandomize=True,
        database=None,
        deadline=None,
        report_multiple_bugs=False,
        phases=(Phase.generate, Phase.shrink),
        suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
    )
    @given(draws)
    def each(x: Floats) -> None:
        hold(x)

    each()


def symmetric_points(subject: Subject) -> Floats:
    """Return the centre of the bounds, corners, edge and face middles of the box and of the box of half its size.

    On shapes with symmetries these are where closest points are not unique.
    """
    dim = subject.source.dim
    signs = np.stack(np.meshgrid(*[[0.0, -1.0, 1.0]] * dim, indexing="ij"), axis=-1).reshape(-1, dim)
    half = 0.5 * np.ptp(subject.source.bounds, axis=0)
    half = np.where(half > 0, half, subject.size)
    points: Floats = subject.centre + np.concatenate([signs, 0.5 * signs[1:], 1e-170 * signs[1:]]) * half
    return points


def _anywhere(subject: Subject) -> st.SearchStrategy[Floats]:
    """Draw a few points that hypothesis chooses, with many at random, some of them on the manifold."""
    dim, known = subject.source.dim, subject.known_points()
    near = st.floats(-2.0, 2.0)
    lattice = st.integers(-4, 4).map(lambda i: 0.25 * i)
    far = st.floats(-1e6, 1e6)
    chosen = st.lists(st.one_of([st.tuples(*[part] * dim) for part in (near, lattice, far)]), min_size=1, max_size=6)

    def batch(points: list[tuple[float, ...]], count: int, seed: int) -> Floats:
        rng = np.random.default_rng(seed)
        relative = np.concatenate([np.array(points), rng.uniform(-1.5, 1.5, (count, dim))])
        x = subject.centre + subject.size * relative
        if known is not None:
            x = np.concatenate([x, rng.permutation(known)[: count // 2]])
        return np.ascontiguousarray(x)

    return st.builds(batch, chosen, st.sampled_from([0, 40]), st.integers(0, 2**16))


def _tube(subject: Subject, radius: float) -> st.SearchStrategy[Floats]:
    """Draw points up to ``radius`` from the manifold."""

    def batch(count: int, seed: int) -> Floats:
        rng = np.random.default_rng(seed)
        near = subject.centre + subject.size * rng.uniform(-0.6, 0.6, (count, subject.source.dim))
        around = subject.source.closest_point(near)
        direction = rng.normal(size=around.points.shape)
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        return np.ascontiguousarray(around.points + radius * rng.uniform(0, 1, (count, 1)) * direction)

    return st.builds(batch, st.integers(1, 64), st.integers(0, 2**16))
