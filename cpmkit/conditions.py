"""What may hold on a side of a boundary: ``alpha du/db + beta u = gamma``.

b is the conormal out of the side that the condition is given on (CONVENTIONS: left -v, right +v,
outward at an edge). Data may be a number, one number a channel, or a function of position.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from cpmkit.errors import InputError
from cpmkit.protocols import Floats

Data = float | list[Any] | tuple[Any, ...] | Floats | Callable[[Floats], Any]


@dataclass(frozen=True, eq=False)
class Dirichlet:
    """u = value.

    Parameters
    ----------
    value : number, sequence, or callable
        A number; one number (or callable) a channel; or a function of points (n, d) that returns
        (n,) or (n, channels).
    order : 1 or 2, optional
        Overrides the discretisation's order for this condition.

    Examples
    --------
    On a circle that nothing else touches, the value at one point is the value everywhere.

    >>> import cpmkit as ck
    >>> square = ck.Dirichlet(lambda points: points[:, 0] ** 2)
    >>> pin = ck.Boundary("pin", ck.source("analytic.point", at=[0.6, 0.8]), both=square)
    >>> scene = ck.Scene(ck.source("analytic.circle"), ck.Laplace(), [pin])
    >>> ck.solve(scene, spacing=0.1).evaluate([[-1, 0]]).round(6)
    array([0.36])
    """

    value: Data
    order: int | None = None
    alpha: float = field(default=0.0, init=False)
    beta: float = field(default=1.0, init=False)

    @property
    def gamma(self) -> Data:
        """Right side of the condition."""
        return self.value

    @property
    def kind(self) -> str:
        """Name of the kind in scene files."""
        return "dirichlet"


@dataclass(frozen=True, eq=False)
class Neumann:
    """du/db = flux, b pointing out of the side on which the condition is given.

    Parameters
    ----------
    flux : number, sequence, or callable
        As for :class:`Dirichlet`. Zero makes the boundary a wall that nothing crosses.
    order : 1 or 2, optional
        Overrides the discretisation's order for this condition.
    """

    flux: Data = 0.0
    order: int | None = None
    alpha: float = field(default=1.0, init=False)
    beta: float = field(default=0.0, init=False)

    @property
    def gamma(self) -> Data:
        """Right side of the condition."""
        return self.flux

    @property
    def kind(self) -> str:
        """Name of the kind in scene files."""
        return "neumann"


@dataclass(frozen=True, eq=False)
class Robin:
    """alpha du/db + beta u = gamma, b pointing out of the side on which the condition is given.

    With alpha and beta of one sign the condition damps, and is well posed. With opposite signs it feeds; a spacing
    too coarse for such a beta is refused.

    Parameters
    ----------
    alpha, beta : float
        Not zero.
    gamma : number, sequence, or callable
        As for :class:`Dirichlet`.
    order : 1 or 2, optional
        Overrides the discretisation's order for this condition.

    Raises
    ------
    InputError
        If alpha or beta is zero, for then the condition is of another kind, or not a finite number.

    Examples
    --------
    >>> Robin(1.0, 3.0, 0.5).kind
    'robin'
    >>> Robin(0.0, 1.0)
    Traceback (most recent call last):
    cpmkit.errors.InputError: alpha of Robin must be a finite number other than zero, got 0.0; use Dirichlet.
    """

    alpha: float
    beta: float
    gamma: Data = 0.0
    order: int | None = None

    def __post_init__(self) -> None:
        for name, other in (("alpha", "Dirichlet"), ("beta", "Neumann")):
            given = getattr(self, name)
            number = _number(given, f"{name} of Robin")
            if not np.isfinite(number) or number == 0:
                raise InputError(
                    f"{name} of Robin must be a finite number other than zero, got {given!r}; use {other}."
                )
            object.__setattr__(self, name, number)

    @property
    def kind(self) -> str:
        """Name of the kind in scene files."""
        return "robin"


Condition = Dirichlet | Neumann | Robin
KINDS = (Dirichlet, Neumann, Robin)


def evaluate_data(data: Data, points: Floats, channels: int | None, what: str) -> Floats:
    """Return data at points as (n, channels).

    Parameters
    ----------
    data : Data
        A number, one entry a channel (numbers or callables), or a callable of the points.
    points : (n, d) float64
        Where the data are read, in the scene's coordinates.
    channels : int or None
        How many channels are wanted; a single number serves all of them. None: as many as the data have.
    what : str
        Named in the error.

    Raises
    ------
    InputError
        If the number of channels differs, a callable returns another shape, or a value is not finite.
    """
    n = len(points)
    if callable(data):
        try:
            values = np.asarray(data(points), dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise InputError(f"{what} must return numbers of shape ({n},) or ({n}, channels): {error}") from error
        if values.ndim == 0:
            values = np.broadcast_to(values, (n,))
        values = values[:, None] if values.ndim == 1 else values
    elif isinstance(data, (list, tuple, np.ndarray)) and np.ndim(np.asarray(data, dtype=object)) > 0:
        parts = [evaluate_data(entry, points, 1, what) for entry in data]
        values = np.concatenate(parts, axis=1) if parts else np.zeros((n, 0))
    else:
        values = np.full((n, 1), _number(data, what))
    if values.ndim != 2 or len(values) != n:
        raise InputError(f"{what} must give shape ({n},) or ({n}, channels) at {n} points, got {values.shape}.")
    if channels is not None and values.shape[1] != channels:
        if values.shape[1] != 1:
            raise InputError(f"{what} has {values.shape[1]} channels where the scene has {channels}.")
        values = np.repeat(values, channels, axis=1)
    if not np.isfinite(values).all():
        raise InputError(
            f"{what} must be finite, got NaN or infinity at {int((~np.isfinite(values)).any(axis=1).sum())} points."
        )
    return np.ascontiguousarray(values)


def channel_count(data: Data, probe: Floats, what: str) -> int:
    """Return how many channels ``data`` has, asked at one point ``probe`` (1, d)."""
    return int(evaluate_data(data, probe, None, what).shape[1])


def _number(data: Any, what: str) -> float:
    try:
        return float(data)
    except (TypeError, ValueError) as error:
        raise InputError(f"{what} must be a number, one entry a channel, or a callable, got {data!r}.") from error
