"""Conformance cases, the decorator of laws, and the queries that hypothesis draws around the bounds of a source."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property, lru_cache, partial, wraps
from typing import Any, Literal

import numpy as np
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from cpmkit.errors import InputError
from cpmkit.manifold.source import ClosestPoints, ClosestPointSource
from cpmkit.types import Bools, Floats

#: Round-off that is allowed, relative to the largest coordinate involved.
ROUND_OFF_SHARE = 1e-12


@dataclass(frozen=True)
class ConformanceCase:
    """One example of a kind of source, on which the laws are checked."""

    kind: str  #: The kind in scene files, ``family.shape``.
    name: str  #: Name that distinguishes the cases of a kind.
    make: Callable[[], ClosestPointSource]  #: Function without arguments that returns the source.
    #: ``samples(rng, n)`` returns points (n, d) that lie on the manifold, found without closest points: with them the
    #: laws detect a foot that is farther away than one of the points.
    samples: Callable[[np.random.Generator, int], Floats] | None = None
    #: For a source that is not exact: the distance from the manifold up to which feet are meant to be accurate.
    #: ``None``: anywhere.
    radius: float | None = None
    #: The angle in radians by which feet (of a source that is not exact) and normals (of any source) may be off:
    #: ``|points - exact foot|`` <= turning angle x distance. For a mesh the largest angle between neighbouring normals;
    #: for a smooth manifold 0.
    turning_angle: float = 0.0

    def __str__(self) -> str:
        return f"{self.kind} ({self.name})"


Law = Callable[[ConformanceCase], None]


@dataclass(frozen=True, eq=False)
class Subject:
    """A source under test, and the length to which tolerances are relative."""

    case: ConformanceCase  #: The case that made the source.
    source: Any  #: ClosestPointSource: the source that ``case.make`` returned.
    centre: Floats  #: (d,): centre of the source's bounds.
    size: float  #: Diagonal of the bounds; for a single point its largest coordinate, or 1 at the origin.
    #: Answers of the source by the bytes of their queries.
    answers: dict[bytes, ClosestPoints] = field(default_factory=dict)

    def round_off(self, x: Floats) -> Floats:
        """Return the length (n,) by which rounding may change the answers to queries ``x`` (n, d)."""
        largest = np.abs(x).max(axis=1) + np.abs(self.source.bounds).max() + self.size
        return np.asarray(ROUND_OFF_SHARE * largest)

    def feet(self, x: Floats) -> ClosestPoints:
        """Return the closest points of ``x`` (n, d), computed once for all laws that only read them."""
        key = x.tobytes()
        if key not in self.answers:
            self.answers[key] = self.source.closest_point(x.copy())
        return self.answers[key]

    @cached_property
    def known_points(self) -> Floats:
        """(k, d) points of the manifold from the case's ``samples``; none if it has no samples."""
        if self.case.samples is None:
            return np.empty((0, len(self.centre)))
        return self.case.samples(np.random.default_rng(0), 256)


@lru_cache(maxsize=1)
def subject(case: ConformanceCase) -> Subject:
    """Return the subject of a case; the last one is cached, so that laws which are checked in turn share it."""
    source = case.make()
    lower, upper = np.asarray(source.bounds, dtype=np.float64)
    diagonal = float(np.linalg.norm(upper - lower))
    size = diagonal or float(np.abs(lower).max()) or 1.0
    return Subject(case, source, 0.5 * (lower + upper), size)


def _check_queries(subject: Subject, check: Callable[[Floats], None], near: bool, together: bool) -> None:
    """Call ``check`` with batches of queries (n, d), or once with all if ``together``.

    Queries are the same in every run: around the bounds, far out, and on the manifold; if ``near`` within the case's
    radius. If ``check`` raises, the exception for a small batch is raised if there is one on which it raises too.
    """
    try:
        batches = _query_batches(subject, near)
        for x in [np.concatenate(batches)] if together else batches:
            check(x.copy())
    except Exception as failure:
        _generate_queries(subject, near, check)  # fails on the same batches, and shows a small one
        raise failure


@lru_cache(maxsize=2)
def _query_batches(subject: Subject, near: bool) -> tuple[Floats, ...]:
    """Return the batches (n, d) that hypothesis draws if none fails; cached, since drawing takes long."""
    drawn: list[Floats] = []
    _generate_queries(subject, near, drawn.append)
    return tuple(drawn)


def _generate_queries(subject: Subject, near: bool, hold: Callable[[Floats], None]) -> None:
    """Call ``hold`` with 20 batches of queries (n, d) that hypothesis draws, and reduce a batch for which it raises.

    Queries are ``near`` the manifold, or anywhere in its box.
    """
    draws = _near_queries(subject) if near else _scattered_queries(subject)

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

    each()  # hypothesis draws by the text of this function: another text would draw other queries


def symmetric_points(subject: Subject) -> Floats:
    """Return points (n, d) at which the closest points of symmetric shapes are not unique.

    They are the centre of the bounds, and the corners and middles of edges and faces of the box, of its half and of a
    tiny box around the centre.
    """
    dim = subject.source.dim
    signs = np.stack(np.meshgrid(*[[0.0, -1.0, 1.0]] * dim, indexing="ij"), axis=-1).reshape(-1, dim)
    half = 0.5 * np.ptp(subject.source.bounds, axis=0)
    half = np.where(half > 0, half, subject.size)
    return np.asarray(subject.centre + np.concatenate([signs, 0.5 * signs[1:], 1e-170 * signs[1:]]) * half)


def _scattered_queries(subject: Subject) -> st.SearchStrategy[Floats]:
    """Return a strategy for batches (n, d): points chosen by hypothesis up to 1e6 sizes away, random and known ones."""
    dim, known = subject.source.dim, subject.known_points
    near = st.floats(-2.0, 2.0)
    lattice = st.integers(-4, 4).map(lambda i: 0.25 * i)
    far = st.floats(-1e6, 1e6)
    chosen = st.lists(st.one_of([st.tuples(*[part] * dim) for part in (near, lattice, far)]), min_size=1, max_size=6)

    def batch(points: list[tuple[float, ...]], count: int, seed: int) -> Floats:
        """Return ``points``, scaled to the source, ``count`` random ones, and up to half as many of the known ones."""
        rng = np.random.default_rng(seed)
        relative = np.concatenate([np.array(points), rng.uniform(-1.5, 1.5, (count, dim))])
        x = subject.centre + subject.size * relative
        return np.concatenate([x, rng.permutation(known)[: count // 2]])

    return st.builds(batch, chosen, st.sampled_from([0, 40]), st.integers(0, 2**16))


def _near_queries(subject: Subject) -> st.SearchStrategy[Floats]:
    """Return a strategy for batches (n, d) of points whose distances from the manifold are up to ``case.radius``."""
    radius = subject.case.radius or 0.0

    def batch(count: int, seed: int) -> Floats:
        """Return ``count`` points at random distances up to ``radius`` from random closest points."""
        rng = np.random.default_rng(seed)
        near = subject.centre + subject.size * rng.uniform(-0.6, 0.6, (count, subject.source.dim))
        around = subject.source.closest_point(near)
        direction = rng.normal(size=around.points.shape)
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        return np.ascontiguousarray(around.points + radius * rng.uniform(0, 1, (count, 1)) * direction)

    return st.builds(batch, st.integers(1, 64), st.integers(0, 2**16))


def law(
    where: Literal["", "anywhere", "near", "near unless exact"] = "", ability: Any = object, together: bool = False
) -> Callable[[Callable[..., None]], Law]:
    """Return a decorator that turns a check of a subject, or of a subject and queries (n, d), into a law.

    ``where``: where queries lie: anywhere, near (within the case's radius, if any), or near unless the source is exact.
        Empty if the check takes no queries.
    ``ability``, type: sources without it obey the law.
    ``together``: whether queries of all batches are checked at once, for a law about each row or each pair of rows.
    """

    def decorate(check: Callable[..., None]) -> Law:
        """Return the law of a check: a function of a case that raises AssertionError with the law's name."""

        @wraps(check)
        def check_case(case: ConformanceCase) -> None:
            """Raise AssertionError, with the names of case and law, if the source of ``case`` breaks the law."""
            sentence = (check.__doc__ or "").partition("\n")[0]
            try:
                about = subject(case)
                near = where == "near" or (where == "near unless exact" and not about.source.exact)
                if not isinstance(about.source, ability):
                    return
                if where:
                    _check_queries(about, partial(check, about), near and case.radius is not None, together)
                else:
                    check(about)
            except AssertionError as error:
                raise AssertionError(f"{case} breaks the law {check.__name__} ({sentence}) {error}") from None
            except Exception as error:
                error.add_note(f"{case} raised this under the law {check.__name__} ({sentence})")
                raise

        return check_case

    return decorate


def require(condition: Any, message: str) -> None:
    """Raise AssertionError with ``message`` unless the ``condition`` of a law is true."""
    if not condition:
        raise AssertionError(message)


def require_rows(condition: Any, x: Floats, message: str, values: NDArray[Any] | None = None) -> None:
    """Raise AssertionError if a ``condition`` (n,) is false: ``message``, the row of ``values``, and that of ``x``."""
    failing = np.flatnonzero(~condition)
    if len(failing):
        first = failing[0]
        value = "" if values is None else f": {np.array2string(np.asarray(values[first]), precision=17)}"
        raise AssertionError(f"{message}{value} at the query {x[first].tolist()} ({len(failing)} of {len(x)} queries).")


def require_refusal(call: Callable[[], object], fault: str) -> None:
    """Raise AssertionError unless ``call()``, whose queries have the ``fault`` in words, raises InputError."""
    try:
        call()
    except InputError:
        return
    except Exception as error:
        raise AssertionError(f"Queries with {fault} raise {type(error).__name__}, not InputError.") from error
    raise AssertionError(f"Queries with {fault} are accepted.")


def certain_rows(feet: ClosestPoints) -> Bools:
    """Return a mask (n,): True where ``feet`` are not marked as doubtful; all True if the source marks none."""
    return np.ones(len(feet), dtype=np.bool_) if feet.doubtful is None else ~feet.doubtful
