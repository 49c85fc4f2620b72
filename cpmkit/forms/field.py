"""Fields: values at the points where a discretised scene keeps them, and what is made of them there."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from cpmkit.errors import InputError, shown
from cpmkit.forms.contract import Discretized
from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.tangent_space import project_tangent
from cpmkit.protocols import ClosestPointSource, Floats
from cpmkit.scene.functionals import Divergence

#: Step of differences of closest points, in spacings, for sources without normals of their own.
DIFFERENCE_SPACINGS = 0.1
#: A sequence of more entries is not one a channel, but values at points, and of wrong number.
MOST_CHANNELS = 64


@dataclass(frozen=True, eq=False)
class Field:
    """Values at the points of a prepared scene: samples of the Galerkin form, feet of the collocation form.

    A field is a function of points as any other: right-hand sides, initial data, velocities, diffusivities and factors
    accept it. At its own points, where a problem on the same prepared scene reads it, it gives the values as they are;
    elsewhere what the form's own functions make of them. Made by ``prepared.field(data)``.

    Attributes
    ----------
    form : Discretized
        With the points.
    values : (p,) or (p, channels) float64
        The values.
    unknowns : (n, channels) float64, optional
        Of the function that has these values, where it is known: that of a solution.

    Examples
    --------
    >>> import cpmkit as ck
    >>> prepared = ck.prepare(ck.Scene(ck.source("analytic.sphere"), ck.Poisson(0.0)), spacing=0.2)
    >>> height = prepared.field(lambda points: points[:, 2])
    >>> bool(abs(height.gradient().map(lambda points, slopes: (slopes**2).sum(axis=1)).mean() - 2 / 3) < 1e-3)
    True
    """

    form: Discretized
    values: Floats
    unknowns: Floats | None = None

    def __post_init__(self) -> None:
        values = np.array(self.values, dtype=np.float64)
        if values.ndim not in (1, 2) or len(values) != len(self.points) or not np.isfinite(values).all():
            raise InputError(
                f"values of a field must be finite, one row for each of the {len(self.points)} points, got shape "
                f"{values.shape}{'' if np.isfinite(values).all() else ' with NaN or infinity in it'}."
            )
        object.__setattr__(self, "values", values)

    @cached_property
    def points(self) -> Floats:
        """(p, d) its points, in the scene's coordinates; all fields share them, and they are not written to."""
        return self.form.points

    @property
    def columns(self) -> Floats:
        """(p, channels) the values, one channel a column."""
        return self.values if self.values.ndim == 2 else self.values[:, None]

    @property
    def channels(self) -> int:
        """How many."""
        return int(self.columns.shape[1])

    def __call__(self, points: Floats) -> Floats:
        """Return the values (k,) or (k, channels) at points (k, d) of the manifold."""
        own = self.points
        if not len(points):
            return self.values[:0]
        if points is own or (np.shape(points) == own.shape and np.array_equal(points, own)):
            return self.values
        found = self.form.evaluate(self._unknowns, points)
        return found if self.values.ndim == 2 else found[:, 0]

    @cached_property
    def _unknowns(self) -> Floats:
        return self.form.project(self.columns) if self.unknowns is None else self.unknowns

    def map(self, function: Callable[..., Any]) -> Field:
        """Return the field of ``function(points, values)``, which gives (p,) or (p, channels)."""
        values = np.asarray(function(self.points, self.values), dtype=np.float64)
        return Field(self.form, values)

    def gradient(self) -> Field:
        """Return the tangential gradient (p, d) of a field of one channel, side by side right up to boundaries.

        Raises
        ------
        InputError
            If it has several channels.
        """
        if self.channels != 1:
            raise InputError(f"the gradient is that of one channel, got {self.channels}; take them one by one.")
        return Field(self.form, self.form.gradient(self._unknowns)[:, 0])

    def divergence(self, scale: float = 1.0) -> Divergence:
        """Return ``scale`` times the divergence of a field of vectors (p, d), for a right-hand side.

        Weakly, by its integrals times the gradients of the functions that test it: nothing is differentiated.

        Raises
        ------
        InputError
            If it has not as many channels as the manifold's space has dimensions.
        """
        if self.values.shape != self.points.shape:
            raise InputError(
                f"the divergence is that of vectors, {self.points.shape[1]} channels, got {self.columns.shape[1]}."
            )
        return Divergence(self, scale)

    def project(self, onto: ClosestPointSource | None = None) -> Field:
        """Return the vectors' tangential part; with ``onto`` the points of a source that are closest to the values."""
        if self.columns.shape[1] != self.points.shape[1] and onto is None:
            raise InputError(f"vectors have {self.points.shape[1]} channels, got {self.columns.shape[1]}.")
        if onto is not None:
            if self.columns.shape[1] != onto.dim:
                raise InputError(f"points of the target have {onto.dim} channels, got {self.columns.shape[1]}.")
            return replace(self, values=onto.closest_point(self.columns).points, unknowns=None)
        return replace(self, values=tangential(self.form, self.points, self.values), unknowns=None)

    def resolved(self) -> Field:
        """Return what the form's own functions make of the values, at the same points: as fine as the lattice."""
        return Field(self.form, self.form.at_points(self._unknowns).reshape(self.values.shape), self._unknowns)

    def mean(self) -> float | Floats:
        """Return the mean over the manifold, a float or (channels,), by the weights of the points."""
        weights = self.form.point_weights
        found = np.average(self.values, axis=0, weights=weights)
        return float(found) if found.ndim == 0 else found

    def energy(self) -> float:
        """Return the integral of |grad u|^2 / 2 over the manifold, of all channels together.

        Raises
        ------
        InputError
            In a form whose points have no weights, as ``collocation``.
        """
        weights = self.form.point_weights
        if weights is None:
            raise InputError(
                f"the energy is summed over points with weights, which the form {self.form.form!r} has not; use the "
                "form 'galerkin'."
            )
        slopes = self.form.gradient(self._unknowns)
        return 0.5 * float(np.einsum("p,pcd,pcd->", weights, slopes, slopes))

    def __repr__(self) -> str:
        count, channels = self.columns.shape
        return f"Field of {channels} channel{'s' * (channels > 1)} at {count} points of the form {self.form.form!r}"


def tangential(form: Discretized, points: Floats, vectors: Floats) -> Floats:
    """Return the tangential part (k, d) of ``vectors`` (k, d) at ``points`` (k, d) of the manifold."""
    surface = LocalSource(form.scene.surface, np.zeros(points.shape[1]))
    feet = surface.closest_point(points)
    return project_tangent(surface, feet, vectors, DIFFERENCE_SPACINGS * form.spacing)


def field_of(form: Discretized, data: Any) -> Field:
    """Return the field of ``data`` at the points of ``form``: a number, one entry a channel, values, or a function.

    A solution on the same tables is read without loss.

    Raises
    ------
    InputError
        If it is none of these.
    """
    from cpmkit.scene.data import evaluate_data

    own = getattr(data, "discretized", None)
    if isinstance(own, Discretized):
        here, there = form.points, own.points
        if own.size == form.size and (here is there or np.array_equal(here, there)):
            values = form.at_points(data.values)
            return Field(form, values if values.shape[1] > 1 else values[:, 0], data.values)
        data = data.evaluate
    points = form.points
    if isinstance(data, np.ndarray) and data.shape[:1] == (len(points),):
        return Field(form, data)
    if not callable(data) and (np.ndim(np.asarray(data, dtype=object)) > 1 or np.size(data) > MOST_CHANNELS):
        raise InputError(
            "a field is made of a number, one entry a channel, a function, a solution, or an array of "
            f"{len(points)} rows, one for each point, got {shown(data)}."
        )
    values = evaluate_data(data, points, None, "a field")
    return Field(form, values if values.shape[1] > 1 else values[:, 0])
