"""What may hold on a side of a boundary: ``alpha du/db + beta u = gamma``.

b is the conormal out of the side that the condition is given on (CONVENTIONS: left -v, right +v,
outward at an edge). Data may be a number, one number a channel, or a function of position.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from cpmkit.arrays import positive
from cpmkit.errors import CpmkitError, InputError
from cpmkit.protocols import Floats

Data = float | list[Any] | tuple[Any, ...] | Floats | Callable[..., Any]


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
    alpha : float
        Not zero.
    beta : number or callable
        Not zero; a callable of points (n, d) returns (n,).
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
    beta: float | Callable[..., Any]
    gamma: Data = 0.0
    order: int | None = None

    def __post_init__(self) -> None:
        for name, other in (("alpha", "Dirichlet"), ("beta", "Neumann")):
            given = getattr(self, name)
            if name == "beta" and callable(given) and not takes_time(given):
                continue
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


@dataclass(frozen=True, eq=False)
class Transmission:
    """Both sides coupled: ``u_left - u_right = jump + resistance * flow``, and what flows in on one side flows out.

    With k the conductivities, ``k_left du/db_left + k_right du/db_right = flux``, each b out of its side; a ``flux``
    above zero is a source of heat on the boundary. The flow is the mean of ``-k_left du/db_left`` and
    ``k_right du/db_right``, from left to right. Given to a boundary as ``across``.

    Parameters
    ----------
    jump : number, sequence, or callable
        As for :class:`Dirichlet`.
    flux : number, sequence, or callable
        As for :class:`Dirichlet`.
    left, right : float
        Conductivities, above zero: the diffusivity of the problem on each side.
    resistance : float
        Of the contact, not below zero.

    Raises
    ------
    InputError
        If a conductivity is not above zero or the resistance is below.

    Examples
    --------
    >>> Transmission(left=1.0, right=5.0).kind
    'transmission'
    """

    jump: Data = 0.0
    flux: Data = 0.0
    left: float = 1.0
    right: float = 1.0
    resistance: float = 0.0
    order: None = field(default=None, init=False)
    alpha: float = field(default=1.0, init=False)
    beta: float = field(default=0.0, init=False)

    def __post_init__(self) -> None:
        positive(self.left, "left, a conductivity of Transmission,")
        positive(self.right, "right, a conductivity of Transmission,")
        if self.resistance != 0:
            positive(self.resistance, "resistance of Transmission, where it is not zero,")

    @property
    def gamma(self) -> Data:
        """Right side of the condition on the values."""
        return self.jump

    @property
    def kind(self) -> str:
        """Name of the kind in scene files."""
        return "transmission"


def eigenfunction(points: Floats) -> Floats:
    """Mark the data of a :class:`Steklov` condition: lambda u, which is no datum and counts as zero."""
    return np.zeros(len(points))


@dataclass(frozen=True, eq=False)
class Steklov:
    """du/db = lambda u, for eigenvalue problems alone: lambda is what is sought.

    Parameters
    ----------
    order : 1 or 2, optional
        Overrides the discretisation's order for this condition.

    Examples
    --------
    Those of the unit disc, a solid of the plane, are 0, 1, 1, 2, 2.

    >>> import cpmkit as ck
    >>> scene = ck.Scene(ck.source("solid", of=ck.source("analytic.circle")), ck.Eigen(5), edge=ck.Steklov())
    >>> ck.solve(scene, spacing=0.05).eigenvalues.round(2) + 0.0
    array([0., 1., 1., 2., 2.])
    """

    order: int | None = None
    alpha: float = field(default=1.0, init=False)
    beta: float = field(default=0.0, init=False)

    @property
    def gamma(self) -> Data:
        """Marks what stands for lambda u."""
        return eigenfunction

    @property
    def kind(self) -> str:
        """Name of the kind in scene files."""
        return "steklov"


@dataclass(frozen=True, eq=False)
class SupportData:
    """The data of :class:`SimplySupported`: called, they give u; beside that they hold Lap u."""

    value: Data
    laplacian: Data

    def __call__(self, points: Floats) -> Floats:
        """Return u at ``points`` (n, d) as (n, channels)."""
        return evaluate_data(self.value, points, None, "the value of SimplySupported")


@dataclass(frozen=True, eq=False)
class SimplySupported:
    """u = value and Lap u = laplacian, for biharmonic problems alone: an edge that holds a plate and lets it turn.

    Parameters
    ----------
    value, laplacian : number, sequence, or callable
        As for :class:`Dirichlet`.
    order : 1 or 2, optional
        Overrides the discretisation's order for this condition.

    Examples
    --------
    >>> SimplySupported(laplacian=2.0).kind
    'simply_supported'
    """

    value: Data = 0.0
    laplacian: Data = 0.0
    order: int | None = None
    alpha: float = field(default=0.0, init=False)
    beta: float = field(default=1.0, init=False)

    @property
    def gamma(self) -> Data:
        """Both data."""
        return SupportData(self.value, self.laplacian)

    @property
    def kind(self) -> str:
        """Name of the kind in scene files."""
        return "simply_supported"


@dataclass(frozen=True, eq=False)
class NonlinearFlux:
    """du/db = j(u), b pointing out of the side on which the condition is given: radiation, a reaction at the wall.

    Solved by Newton's method, each step a Robin condition. Where j grows with u it feeds the solution, and there may
    be none, or several.

    Parameters
    ----------
    flux : callable
        j, a function of values (n,), or of values and points ``(n,), (n, d)``, that returns (n,).
    slope : callable, optional
        Its derivative, of the same arguments; by differences unless given.
    guess : float
        Value of u on the boundary at which Newton's method starts.
    order : 1 to 4, optional
        Overrides the discretisation's order for this condition.

    Raises
    ------
    InputError
        If the flux or its slope is not callable.

    Examples
    --------
    A bar that is heated at one end and radiates at the other: u = 2 - x.

    >>> import cpmkit as ck
    >>> bar = ck.source("analytic.segment", start=[0, 0], end=[1, 0])
    >>> ends = {0: ck.Dirichlet(2.0), 1: ck.NonlinearFlux(lambda u: -(u**4))}
    >>> ck.solve(ck.Scene(bar, ck.Laplace(), edge=ends), spacing=0.05).evaluate([[1, 0]]).round(4)
    array([1.])
    """

    flux: Callable[..., Any]
    slope: Callable[..., Any] | None = None
    guess: float = 1.0
    order: int | None = None
    alpha: float = field(default=1.0, init=False)
    beta: float = field(default=0.0, init=False)

    def __post_init__(self) -> None:
        for name, optional in (("flux", False), ("slope", True)):
            given = getattr(self, name)
            if not callable(given) and not (optional and given is None):
                raise InputError(f"{name} of NonlinearFlux must be a function of the values of u, got {given!r}.")

    @property
    def gamma(self) -> Data:
        """Right side of the condition before the first step."""
        return 0.0

    @property
    def kind(self) -> str:
        """Name of the kind in reports."""
        return "nonlinear flux"


Condition = Dirichlet | Neumann | Robin | Transmission | Steklov | NonlinearFlux | SimplySupported
#: What may stand on one side of a boundary, or on an edge.
KINDS = (Dirichlet, Neumann, Robin, Steklov, NonlinearFlux, SimplySupported)


def takes_time(data: Data) -> bool:
    """Tell whether data, or one entry of them, is a callable with a parameter ``t``."""
    if isinstance(data, (list, tuple)):
        return any(takes_time(entry) for entry in data)
    if not callable(data):
        return False
    told = getattr(data, "takes_time", None)
    if isinstance(told, bool):
        return told
    try:
        return "t" in inspect.signature(data).parameters
    except (TypeError, ValueError):  # some built-in functions tell no signature
        return False


def evaluate_data(data: Data, points: Floats, channels: int | None, what: str, time: float | None = None) -> Floats:
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
    time : float, optional
        Given to callables with a parameter ``t``.

    Raises
    ------
    InputError
        If the number of channels differs, a callable returns another shape, a value is not finite, or a callable
        asks for the time of a problem that has none.
    """
    n = len(points)
    if callable(data):
        if takes_time(data) and time is None:
            raise InputError(f"{what} depends on t, and the problem has no time; use Heat or Wave.")
        try:
            values = np.asarray(data(points, t=time) if takes_time(data) else data(points), dtype=np.float64)
        except CpmkitError:
            raise
        except (TypeError, ValueError) as error:
            raise InputError(f"{what} must return numbers of shape ({n},) or ({n}, channels): {error}") from error
        if values.ndim == 0:
            values = np.broadcast_to(values, (n,))
        values = values[:, None] if values.ndim == 1 else values
    elif isinstance(data, (list, tuple, np.ndarray)) and np.ndim(np.asarray(data, dtype=object)) > 0:
        parts = [evaluate_data(entry, points, 1, what, time) for entry in data]
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


def channel_count(data: Data, probe: Floats, what: str, time: float | None = None) -> int:
    """Return how many channels ``data`` has, asked at one point ``probe`` (1, d) and at ``time``."""
    return int(evaluate_data(data, probe, None, what, time).shape[1])


def _number(data: Any, what: str) -> float:
    try:
        return float(data)
    except (TypeError, ValueError) as error:
        raise InputError(f"{what} must be a number, one entry a channel, or a callable, got {data!r}.") from error
