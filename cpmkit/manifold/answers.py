"""What closest point sources answer, checked: a wrong answer is blamed on its source, not on what is made of it."""

from __future__ import annotations

from typing import Any

import numpy as np

from cpmkit.errors import InputError
from cpmkit.protocols import ClosestPoints, ClosestPointSource, Floats


def check_answer(answer: Any, x: Floats, source: Any, origin: Floats, union: bool) -> None:
    """Refuse what is no record of a closest point for each query.

    Parameters
    ----------
    answer : ClosestPoints
        What the source gave.
    x : (n, d) float64
        The queries, relative to ``origin`` (d,), which lies there in the user's coordinates.
    source : object
        Named in the message.
    union : bool
        Whether it has members, of which the answer must name one for each query.

    Raises
    ------
    InputError
        If the answer is of another type or shape, or a foot or distance is not finite.
    """
    name = _name(source)
    if not isinstance(answer, ClosestPoints):
        raise InputError(
            f"closest_point of {name} must return ClosestPoints(points, distance, edge), got {type(answer).__name__}."
        )
    for what, shape in (("points", x.shape), ("distance", x.shape[:1]), ("edge", x.shape[:1])):
        got = np.shape(getattr(answer, what))
        if got != shape:
            raise InputError(
                f"closest_point of {name} must return {what} of shape {shape} for {len(x)} queries, got {got}."
            )
    if union and answer.element is None:
        raise InputError(f"closest_point of {name}, a union, must say by element which member each foot is on.")
    bad = ~(np.isfinite(answer.distance) & np.isfinite(answer.points).all(axis=1))
    if bad.any():
        first = int(np.argmax(bad))
        raise InputError(
            f"closest_point of {name} must return finite points and distances, got "
            f"{np.asarray(answer.points)[first].tolist()} at distance {float(answer.distance[first]):g} for the query "
            f"{(x[first] + origin).tolist()} and for {int(bad.sum())} of {len(x)} queries."
        )


def _name(source: Any) -> str:
    """Return the name of a source's class, and of what it combines: a combination answers what that does."""
    inner = getattr(source, "of", None)
    return type(source).__name__ + (f" of {_name(inner)}" if hasattr(inner, "closest_point") else "")


def check_source(source: Any, what: str, also: str = "") -> None:
    """Refuse what does not answer closest point queries; ``also`` names what else is accepted.

    Raises
    ------
    InputError
        If ``source`` is no ClosestPointSource, or its bounds are not finite.
    """
    if not isinstance(source, ClosestPointSource):
        raise InputError(
            f"{what} must be a closest point source (dim, manifold_dim, bounds, exact, closest_point)"
            f"{also and ', or ' + also}, got {type(source).__name__}."
        )
    bounds = np.asarray(source.bounds, dtype=np.float64)
    if bounds.shape != (2, source.dim) or not np.isfinite(bounds).all():
        raise InputError(f"the bounds of {what} must be (2, {source.dim}) finite numbers, got {bounds.tolist()}.")
