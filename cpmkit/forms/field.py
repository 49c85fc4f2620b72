"""Fields: values at the points of a discretised scene, which serve as functions of position."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from cpmkit.errors import InputError, shown
from cpmkit.forms.contract import Discretized
from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.source import ClosestPointSource
from cpmkit.manifold.tangent_space import project_tangent
from cpmkit.runtime.deprecation import DeprecatedMember
from cpmkit.scene.data import evaluate_data
from cpmkit.scene.special_data import Divergence
from cpmkit.types import Floats

#: Step of differences of closest points, in spacings, for sources without normals of their own.
DIFFERENCE_SPACINGS = 0.1
#: A sequence with more entries than this counts as values of a wrong length, not as one value for each channel.
MOST_CHANNELS = 64


@dataclass(frozen=True, eq=False)
class Field:
    """Values at the points of a prepared scene: samples of the Galerkin form, closest points of the collocation form.

    A field is a function of points like any other: right-hand sides, initial data, velocities, diffusivities and
    factors accept it. At its own points it returns the values as they are; elsewhere it interpolates with the functions
    of the form. Made by ``prepared.field(data)``.

    Examples
    --------
    >>> import cpmkit as ck
    >>> prepared = ck.prepare(ck.Scene(ck.source("analytic.sphere"), ck.Poisson(0.0)), spacing=0.2)
    >>> height = prepared.field(lambda points: points[:, 2])
    >>> bool(abs(height.gradient().map(lambda points, slopes: (slopes**2).sum(axis=1)).mean() - 2 / 3) < 1e-3)
    True
    """

    form: Discretized  #: The form at whose points the values are.
    values: Floats  #: (p,) or (p, channels): the values at the points of the form.
    #: (n, channels): unknowns of the function with these values, if they are known, as for a solution.
    unknowns: Floats | None = None

    def __post_init__(self) -> None:
        """Copy the values; raise InputError if they are not finite, or not one row for each point."""
        values = np.array(self.values, dtype=np.float64)
        if values.ndim not in (1, 2) or len(values) != len(self.points) or not np.isfinite(values).all():
            raise InputError(
                f"values of a field must be finite, one row for each of the {len(self.points)} points, got shape "
                f"{values.shape}{'' if np.isfinite(values).all() else ' with NaN or infinity in it'}."
            )
        object.__setattr__(self, "values", values)

    @cached_property
    def points(self) -> Floats:
        """(p, d) the points in the scene's coordinates; read-only, and shared by all fields of a form."""
        return self.form.points

    @property
    def columns(self) -> Floats:
        """(p, channels) the values, a column for each channel."""
        return self.values if self.values.ndim == 2 else self.values[:, None]

    @property
    def channels(self) -> int:
        """Number of channels."""
        return int(self.columns.shape[1])

    def __call__(self, points: Floats) -> Floats:
        """Return the values (k,) or (k, channels) at points (k, d) of the manifold; at its own points, ``values``."""
        if not len(points):
            return self.values[:0]
        if points is self.points or (np.shape(points) == self.points.shape and np.array_equal(points, self.points)):
            return self.values
        values = self.form.evaluate(self._unknowns, points)
        return values if self.values.ndim == 2 else values[:, 0]

    @cached_property
    def _unknowns(self) -> Floats:
        """(n, channels) the given unknowns, or those of the projection of the values."""
        return self.form.project(self.columns) if self.unknowns is None else self.unknowns

    def map(self, function: Callable[..., Any]) -> Field:
        """Return the field of values ``function(points, values)``, (p,) or (p, channels); InputError for others."""
        values = np.asarray(function(self.points, self.values), dtype=np.float64)
        return Field(self.form, values)

    def gradient(self) -> Field:
        """Return the field of the tangential gradient (p, d) of a field of one channel, one-sided at boundaries.

        Raises InputError if the field has several channels, or the form evaluates no gradients.
        """
        if self.channels != 1:
            raise InputError(f"the gradient is that of one channel, got {self.channels}; take them one by one.")
        return Field(self.form, self.form.gradient(self._unknowns)[:, 0])

    def divergence(self, scale: float = 1.0) -> Divergence:
        """Return ``scale`` times the weak divergence of a field of vectors (p, d), for a right-hand side.

        The divergence is represented by integrals of the field times gradients of test functions.
        Raises InputError if the field does not have one channel for each dimension of space.
        """
        if self.values.shape != self.points.shape:
            raise InputError(
                f"the divergence is that of vectors, {self.points.shape[1]} channels, got {self.columns.shape[1]}."
            )
        return Divergence(self, scale)

    def project(self, onto: ClosestPointSource | None = None) -> Field:
        """Return the field of the tangential parts of vectors; with ``onto``, of the closest points of values there.

        Raises InputError if the field does not have one channel for each dimension of space, that of ``onto`` if given.
        """
        if self.columns.shape[1] != self.points.shape[1] and onto is None:
            raise InputError(f"vectors have {self.points.shape[1]} channels, got {self.columns.shape[1]}.")
        if onto is not None:
            if self.columns.shape[1] != onto.dim:
                raise InputError(f"points of the target have {onto.dim} channels, got {self.columns.shape[1]}.")
            return replace(self, values=onto.closest_point(self.columns).points, unknowns=None)
        surface = LocalSource(self.form.scene.surface, np.zeros(self.points.shape[1]))
        feet, step = surface.closest_point(self.points), DIFFERENCE_SPACINGS * self.form.spacing
        return replace(self, values=project_tangent(surface, feet, self.values, step), unknowns=None)

    def projected(self) -> Field:
        """Return the field, at the same points, of the values' projection on the functions of the form."""
        values = self.form.at_points(self._unknowns)
        return replace(self, values=values.reshape(self.values.shape), unknowns=self._unknowns)

    resolved = DeprecatedMember("projected")

    def mean(self) -> float | Floats:
        """Return the mean over the manifold, a number or (channels,); the plain mean if the points have no weights."""
        mean = np.average(self.values, axis=0, weights=self.form.point_weights)
        return float(mean) if mean.ndim == 0 else mean

    def energy(self) -> float:
        """Return the integral of |grad u|^2 / 2 over the manifold, summed over the channels.

        Raises InputError if the points of the form have no quadrature weights, as in ``collocation``, or no gradients.
        """
        weights = self.form.point_weights
        if weights is None:
            raise InputError(
                f"the energy is summed over points with weights, which the form {self.form.form!r} does not have; use "
                "the form 'galerkin'."
            )
        slopes = self.form.gradient(self._unknowns)
        return 0.5 * float(np.einsum("p,pcd,pcd->", weights, slopes, slopes))

    def __repr__(self) -> str:
        count, channels = self.columns.shape
        return f"Field of {channels} channel{'s' * (channels > 1)} at {count} points of the form {self.form.form!r}"


def field_of(form: Discretized, data: Any) -> Field:
    """Return the field of ``data`` at the points of a form.

    ``data`` are a number, a sequence with one value for each channel, an array of values (p,) or (p, channels) at the
    points, a function of points, or a solution; the field of a solution on the same points keeps its unknowns.
    Raises InputError if the data are none of these.
    """
    other = getattr(data, "discretized", None)
    if isinstance(other, Discretized):
        if other.size == form.size and (form.points is other.points or np.array_equal(form.points, other.points)):
            values = form.at_points(data.values)
            return Field(form, values if values.shape[1] > 1 else values[:, 0], data.values)
        data = data.evaluate
    count = len(form.points)
    if isinstance(data, np.ndarray) and data.shape[:1] == (count,):
        return Field(form, data)
    if not callable(data) and (np.ndim(np.asarray(data, dtype=object)) > 1 or np.size(data) > MOST_CHANNELS):
        raise InputError(
            "a field is made of a number, one entry a channel, a function, a solution, or an array of "
            f"{count} rows, one for each point, got {shown(data)}."
        )
    values = evaluate_data(data, form.points.copy(), None, "a field")
    return Field(form, values if values.shape[1] > 1 else values[:, 0])
