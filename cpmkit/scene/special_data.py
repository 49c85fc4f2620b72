"""Data that are neither numbers nor functions: arrays with one row per vertex, and functionals as right-hand sides."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from cpmkit.errors import InputError, SceneError, shown
from cpmkit.manifold.abilities import HasValues
from cpmkit.manifold.source import ClosestPointSource
from cpmkit.runtime.arrays import as_points, number
from cpmkit.scene.data import Data, Functional, is_sequence, is_zero
from cpmkit.scene.diffusivities import TENSOR_SHAPES
from cpmkit.types import Floats


@dataclass(frozen=True, eq=False)
class VertexData:
    """A function of points that interpolates data at vertices: for conditions, right-hand sides, initial values.

    Its value at a point is the interpolation by ``source`` at the closest point, linear on a mesh and along a polyline.

    Parameters
    ----------
    source : ClosestPointSource
        A mesh, a polyline, a point cloud or a set of points: the surface, or the source of a boundary.
    values : (k,) or (k, channels) array
        In the order of the vertices that the source was made from; k is ``source.value_count``.

    Raises
    ------
    InputError
        If the source does not interpolate values, or the number of rows is not that of its vertices, or a value is not
        finite.

    Examples
    --------
    >>> import cpmkit as ck
    >>> line = ck.source("mesh.polyline", points=[[0, 0], [1, 0], [3, 0]])
    >>> ck.VertexData(line, [0.0, 1.0, 5.0])([[0.5, 0.1], [2.0, 0.0]])
    array([0.5, 3. ])
    """

    source: ClosestPointSource
    values: Any

    def __post_init__(self) -> None:
        """Convert the values to an array, one row per vertex; raise InputError for a wrong source or wrong values."""
        if not isinstance(self.source, HasValues):
            raise InputError(
                f"The source {type(self.source).__name__} carries no values; per-vertex data belong to a mesh, a "
                "polyline, a cloud or a set of points."
            )
        count = self.source.value_count
        try:
            array = np.array(self.values, dtype=np.float64)
        except (TypeError, ValueError, OverflowError) as error:
            got = type(self.values).__name__
            raise InputError(f"values must be numbers, one row a vertex, got {got}.") from error
        if array.ndim not in (1, 2) or len(array) != count or not array.size:
            raise InputError(
                f"values must have the shape ({count},) or ({count}, channels), one row a vertex of the source, got "
                f"{array.shape}."
            )
        bad = np.flatnonzero(~np.isfinite(array.reshape(count, -1)).all(axis=1))
        if len(bad):
            raise InputError(f"values must be finite: {len(bad)} of {count} rows are not, the first is row {bad[0]}.")
        object.__setattr__(self, "values", array)

    def __repr__(self) -> str:
        return f"VertexData({self.source!r}, {np.shape(self.values)} values)"

    def __call__(self, points: Floats) -> Floats:
        """Return the data (n,) or (n, channels) at ``points`` (n, d); raise InputError for points of another shape."""
        source: Any = self.source
        values: Floats = source.interpolate(
            self.values, source.closest_point(np.ascontiguousarray(points, dtype=np.float64))
        )
        return values


#: Lists and arrays of more numbers than this are not one number for each channel.
MOST_CHANNELS = 16


class VertexArrays:
    """Replaces arrays that have one row for each vertex of a surface by :class:`VertexData`.

    A list or tuple has one entry for each channel, of which at most 16 are numbers. An array of NumPy has one row for
    each vertex if it has as many rows as the surface has vertices; a short array has one entry for each channel.
    """

    def __init__(self, surface: ClosestPointSource) -> None:
        """Store the surface and its number of vertices, None if its source interpolates no values."""
        self.surface = surface
        self.count = surface.value_count if isinstance(surface, HasValues) else None
        self._replaced: dict[int, tuple[Any, Any]] = {}

    def replace_arrays(self, instance: Any, label: str) -> Any:
        """Return an equation or condition with arrays replaced by vertex data; an object without arrays is unchanged.

        The result is cached by the object. Raises SceneError if an array that is no tensor has neither one row per
        vertex nor at most 16 rows, or could be read in both ways, or if a list has more than 16 numbers. Raises
        InputError if values are not finite. ``label`` names the object in messages.
        """
        if not hasattr(instance, "__dataclass_fields__"):
            return instance
        if id(instance) not in self._replaced:  # the argument is stored too, so that its id stays unique
            names = [member.name for member in fields(instance) if member.init and "Data" in str(member.type)]
            old = {name: getattr(instance, name) for name in names}
            new = {name: self._as_vertex_data(value, f"{name} of {label}") for name, value in old.items()}
            differs = any(new[name] is not old[name] for name in names)
            self._replaced[id(instance)] = instance, replace(instance, **new) if differs else instance
        return self._replaced[id(instance)][1]

    def _as_vertex_data(self, array: Any, label: str) -> Any:
        """Return an ``array`` with one row per vertex as :class:`VertexData`; other data, also tensors, unchanged.

        Raises SceneError or InputError as :meth:`replace_arrays`; ``label`` is the name of the array in messages.
        """
        if is_sequence(array) and len(array) > MOST_CHANNELS and not any(map(callable, array)):
            raise SceneError(
                f"{label} is a list of {len(array)} entries, and a list has one entry for each channel; give values at "
                "vertices as an array of NumPy, or as ck.VertexData(surface, values)."
            )
        if not isinstance(array, np.ndarray) or array.ndim == 0 or array.shape in TENSOR_SHAPES:
            return array
        if len(array) == self.count:
            if self.count <= 4 and array.ndim == 1:  # as few as the channels of a colour
                raise SceneError(
                    f"{label} is an array of {len(array)} numbers, which may be one value a vertex of the surface or "
                    "as many channels; give a list of channels, or ck.VertexData(surface, values)."
                )
            return VertexData(self.surface, array)
        if len(array) > MOST_CHANNELS:
            known = "carries no values" if self.count is None else f"has {self.count} vertices"
            raise SceneError(
                f"{label} is an array of shape {array.shape}, and the surface {known}; give one row a vertex, a "
                'function of points, a list of channels, or, for values at points X, ck.VertexData(ck.source("points", '
                "at=X), values)."
            )
        return array


@dataclass(frozen=True, eq=False)
class PointSource(Functional):
    """Point sources: f = sum strength_k delta(x - at_k) + beside.

    The load of a spline is its value at the point, so that the total and the first and second moments are exact. The
    solution converges at the usual order away from the points; at a point of a surface the exact solution is unbounded.

    Parameters
    ----------
    at : (k, d) or (d,) array
        Points on or near the manifold, in the scene's coordinates.
    strength : number, (k,) or (k, channels) array
        Inflow at each point; in equations with time, for one unit of time.
    beside : number, sequence or callable
        A function of points that is added to f.

    Raises
    ------
    InputError
        If points or strengths are not finite numbers of these shapes.

    Examples
    --------
    On a circle the solution of -u'' + u = delta is cosh(pi - s) / (2 sinh(pi)).

    >>> import cpmkit as ck
    >>> source = ck.PointSource([[1.0, 0.0]], 2.0)
    >>> scene = ck.Scene(ck.source("analytic.circle"), ck.ScreenedPoisson(source))
    >>> round(float(ck.solve(scene, spacing=0.1).evaluate([[-1, 0]])[0]), 4)
    0.0866
    """

    at: Any
    strength: Any = 1.0
    beside: Data = 0.0

    def __post_init__(self) -> None:
        """Convert ``at`` to (k, d), ``strength`` to (k, channels); raise InputError for other shapes or NaN."""
        try:
            at = np.asarray(self.at, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise InputError(f"the places of a point source must be points (k, d), got {shown(self.at)}.") from error
        points = as_points(at[None] if at.ndim == 1 else at, at.shape[-1] if at.ndim else 0)
        try:
            strength = np.array(self.strength, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise InputError(f"strength of a point source must be numbers, got {shown(self.strength)}.") from error
        if strength.ndim > 2 or not np.isfinite(strength).all() or strength.shape[:1] not in ((), (len(points),)):
            raise InputError(
                f"strength of a point source must be one finite number, or one row for each of the {len(points)} "
                f"points, got shape {strength.shape}."
            )
        strength = np.broadcast_to(strength, (len(points),)) if strength.ndim == 0 else strength
        object.__setattr__(self, "at", points)
        object.__setattr__(self, "strength", strength[:, None] if strength.ndim == 1 else strength)

    @property
    def channels(self) -> int:
        """Number of channels of the strengths."""
        return int(self.strength.shape[1])

    def values(self, form: Any) -> Floats:
        """Return sum_k strength_k phi_i(at_k) (n, channels) for the n test functions phi_i of the ``form``."""
        loads = np.asarray(form.evaluation_matrix(self.at).T @ self.strength)
        return loads if loads.shape[1] == form.scene.channels else np.repeat(loads, form.scene.channels, axis=1)


@dataclass(frozen=True, eq=False)
class Divergence(Functional):
    """f = scale div(X) + beside in weak form, -scale sum X . grad phi, so that X is not differentiated.

    A Neumann condition, also the default zero flux, then prescribes du/db + scale X . b (for -Lap u = f).

    Parameters
    ----------
    of : callable
        X, a function of points (n, d) that returns vectors (n, d); its normal part is ignored.
    scale : float
        Factor of the divergence.
    beside : number, sequence or callable
        A function of points that is added to f.

    Examples
    --------
    On the unit circle the divergence of the tangential part of (0, y) is cos 2 s, and u is cos(2 s) / 5.

    >>> import cpmkit as ck
    >>> field = ck.Divergence(lambda p: p * [0.0, 1.0])
    >>> scene = ck.Scene(ck.source("analytic.circle"), ck.ScreenedPoisson(field, c=1.0))
    >>> ck.solve(scene, spacing=0.1).evaluate([[1, 0], [0, 1]]).round(3)
    array([ 0.2, -0.2])
    """

    of: Callable[[Floats], Any]
    scale: float = 1.0
    beside: Data = 0.0

    def __post_init__(self) -> None:
        """Convert the scale to a float; raise InputError if it is not finite, or the field is not callable."""
        if not callable(self.of):
            raise InputError(f"a divergence is that of a function of points, got {shown(self.of)}.")
        object.__setattr__(self, "scale", number(self.scale, "scale of a divergence"))

    @property
    def channels(self) -> int:
        """Number of channels, one."""
        return 1

    def __neg__(self) -> Divergence:
        return self * -1.0

    def __mul__(self, factor: float) -> Divergence:
        """Return the divergence times a number ``factor``; raise InputError for others, or a ``beside`` not zero."""
        if not is_zero(self.beside):
            raise InputError("a divergence with a function beside it is not multiplied; give its scale.")
        return replace(self, scale=self.scale * number(factor, "a factor of a divergence"))

    __rmul__ = __mul__

    def values(self, form: Any) -> Floats:
        """Return the load of scale div(X): -scale times the integral of X . grad phi_i for each test function phi_i.

        The load (n, channels) for the n test functions of the Galerkin ``form`` is equal in all channels. Raises
        InputError if X, the function ``of``, does not return one finite vector for each point.
        """
        points = form.points
        is_field = getattr(self.of, "points", None) is points  # any other function may write to its argument
        values = np.asarray(self.of(points if is_field else points.copy()), dtype=np.float64)
        if values.shape != points.shape or not np.isfinite(values).all():
            raise InputError(
                f"the field of a divergence must return finite vectors {points.shape} at {len(points)} points, got "
                f"shape {values.shape}."
            )
        return np.repeat(-self.scale * form.gradient_load(values)[:, None], form.scene.channels, axis=1)
