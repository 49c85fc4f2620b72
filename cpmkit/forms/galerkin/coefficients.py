"""Coefficients of equations at the samples: diffusivities, those that depend on u too, factors, velocities."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from cpmkit.errors import InputError, place
from cpmkit.forms.form_records import StateDependentCoefficient
from cpmkit.forms.galerkin.advection import Advection, upstream_times, velocity_at
from cpmkit.forms.galerkin.conditions.nitsche import scale_rows
from cpmkit.forms.galerkin.shared import cached_on_space
from cpmkit.forms.galerkin.space.energy import convection_matrix, gradients_at
from cpmkit.forms.galerkin.values import SplineValues
from cpmkit.linear.operators import CsrOperator
from cpmkit.scene.data import evaluate_data
from cpmkit.scene.diffusivities import evaluate_diffusivity, principal_values
from cpmkit.scene.equations import Terms
from cpmkit.scene.laws import Flux, Mixed
from cpmkit.types import Floats

if TYPE_CHECKING:
    from scipy.sparse import csr_array


#: A tensor whose smallest eigenvalue on tangents is below this share of its largest is not told from a singular one.
SINGULAR_SHARE = 1e-12


def check_positive(a: Floats) -> Floats:
    """Return a diffusivity (k,) if it is positive.

    Raises
    ------
    InputError
        With the smallest value.
    """
    if np.any(a <= 0):
        raise InputError(f"the diffusivity must be above zero, got {a.min():g}.")
    return a


def check_tensor(a: Floats, normals: Floats, points: Floats) -> Floats:
    """Return a diffusivity (k, d, d) if it is positive on tangents at all ``points`` (k, d).

    Parameters
    ----------
    a : (k, d, d) float64
        At the samples.
    normals : (k, c, d) float64
        Orthonormal vectors normal to the manifold.
    points : (k, d) float64
        In the scene's coordinates.

    Raises
    ------
    InputError
        With the place and the smallest eigenvalue.
    """
    least, largest = principal_values(a, normals)
    worst = int(np.argmin(least - SINGULAR_SHARE * largest))
    if least[worst] <= SINGULAR_SHARE * largest[worst]:
        raise InputError(
            f"the diffusivity must be positive definite on tangents of the manifold, got a tensor near "
            f"{place(points[worst])} whose smallest eigenvalue there is {least[worst]:.3g}, and the largest "
            f"{largest[worst]:.3g}."
        )
    return a


@dataclass(frozen=True, eq=False)
class Coefficients(SplineValues):
    """The part of the form that reads coefficients at its samples, those on boundaries included."""

    def _at_samples(self, data: Any, what: str) -> Floats:
        """Return a coefficient (q,) at all samples, (1,) if it is a number; on boundaries their cell's first."""
        if not callable(data) and np.ndim(data) == 0:
            return evaluate_data(data, np.zeros((1, self.space.dof_map.dim)), 1, what)[:, 0]
        return self._and_on_boundaries(self.data_at_points(data, what)[:, 0])

    def _and_on_boundaries(self, own: Floats) -> Floats:
        """Return a coefficient (p, ...) of the manifold's samples at all samples (q, ...)."""
        one = self.sampled
        first = np.searchsorted(one.samples.cell[: one.interior], one.boundary.cell)
        return np.concatenate([own, own[first]])

    def _diffusivity(self, given: Any) -> Floats:
        """Return the diffusivity (q,) or (q, d, d) at all samples, (1,) if it is a number."""
        one = self.sampled
        if not callable(given) and not isinstance(given, StateDependentCoefficient) and np.ndim(given) == 0:
            return check_positive(self._at_samples(given, "the diffusivity"))
        points = self.points.copy() if isinstance(given, StateDependentCoefficient) else self._reading_points(given)
        if isinstance(given, StateDependentCoefficient):
            own = given.coefficient(self.at_points(given.u)[:, 0], self.slopes_at_points(given.u)[:, 0], points)
        else:
            own = evaluate_diffusivity(given, points, "the diffusivity")
        if own.ndim == 3 and len(self._tips):
            raise InputError("tips='singular' takes a diffusivity that is a number, got a tensor; use 'extended'.")
        if own.ndim < 3:
            return self._and_on_boundaries(check_positive(own))
        return self._and_on_boundaries(check_tensor(own, one.samples.normals_at(slice(one.interior)), points))

    def _holding(self, given: Any) -> Floats | None:
        """Return what terms of the form's own are in units of, (q,) at all samples; None for the diffusivity."""
        if not isinstance(given, StateDependentCoefficient) or given.holding is None:
            return None
        return self._diffusivity(StateDependentCoefficient(given.holding, given.u))

    def _carried_by(self, terms: Terms) -> Advection:
        """Return what the velocity of these terms does at the samples, and nothing at those on boundaries."""
        assert terms.velocity is not None
        one, a, c = self.sampled, self._diffusivity(terms.diffusivity), self._at_samples(terms.c, "the factor c")
        rows = slice(one.interior)
        points, normals = one.samples.points_at(rows), one.samples.normals_at(rows)
        v = velocity_at(terms.velocity, points, normals, one.lattice)
        upstream, of_a = upstream_times(np.linalg.norm(v, axis=1), a[: len(v)], self.spacing), v[:0]
        if terms.conservative and upstream.any():
            c = c + self._on_boundaries_too(np.trace(self._nearest_slopes(v), axis1=1, axis2=2))
        if len(a) > 1 and upstream.any():
            of_a = self._on_boundaries_too(self._nearest_slopes(a[: len(v), None])[:, 0])
        v, upstream = self._on_boundaries_too(v), self._on_boundaries_too(upstream)
        return Advection(self.space, v, upstream, a, c, of_a, terms.conservative)

    def _on_boundaries_too(self, values: Floats) -> Floats:
        """Return values at all samples, zero at those on boundaries."""
        return np.concatenate([values, np.zeros((len(self.sampled.boundary), *values.shape[1:]))])

    def _carried_for(self, terms: Terms) -> Advection | None:
        """Return the same, of the scene's own terms as they are kept; None without a velocity."""
        own = self.scene.problem.terms()
        names = "velocity", "diffusivity", "c", "conservative"
        if all(getattr(terms, name) is getattr(own, name) for name in names):
            return self._carried
        return None if terms.velocity is None else self._carried_by(terms)

    @cached_property
    def _carried(self) -> Advection | None:
        """What the velocity of the scene's own equation does; None without one."""
        terms = self.scene.problem.terms()
        return None if terms.velocity is None else self._carried_by(terms)

    @cached_on_space
    def _boundary_rows(self) -> tuple[csr_array, csr_array]:
        """Rows that read u, and du/db out of its own cell, at the samples on boundaries."""
        one, patch = self.sampled.boundary, self.space.dof_map.patch[self.sampled.interior :]
        return self._value_rows(patch, one.points), self._derivative_rows(patch, one.points, one.conormals)

    @property
    def _boundary_spacings(self) -> Floats:
        """(b,) the spacing of the splines at the samples on boundaries, (1,) for all of them."""
        return np.full(1, self.spacing)

    def _beside_boundaries(self, at: StateDependentCoefficient) -> Callable[[Floats], Floats]:
        """Return a coefficient at a state as a function of one point (b, d) beside each boundary sample."""
        one, splines = self.sampled.boundary, at.u[: self._tips.splines]
        patch = self.space.dof_map.patch[self.sampled.interior :]
        values = np.asarray(self._boundary_rows[0] @ splines)[:, 0]
        slopes = gradients_at(self.space, patch, one.points, one.normals, splines)[:, 0]
        return lambda points: at.coefficient(values, slopes, points)

    def advection(self, field: StateDependentCoefficient) -> CsrOperator:
        """Return the integrals of u (w . grad v) over the samples, w (p, d) given at a state.

        Less those of u (w . b) v over boundaries where a slope is given, b the conormal: the flux through them changes
        with u as it does inside.
        """
        w = field.coefficient(self.at_points(field.u)[:, 0], self.slopes_at_points(field.u)[:, 0], self.points.copy())
        inside = convection_matrix(self.space, w)
        given = [one.rows for one in self.sampled.held if isinstance(one.law, (Flux, Mixed))]
        rows = np.concatenate([np.zeros(0, dtype=np.int64), *given])
        if len(rows):
            one = self.sampled.boundary
            at = self.sampled.lattice.to_scene(one.points)
            through = np.einsum("bd,bd->b", self._beside_boundaries(field)(at), one.conormals)
            read = self._boundary_rows[0][rows]
            inside = (inside - read.T @ scale_rows((one.weights * through)[rows], read)).tocsr()
        return CsrOperator(self._tips.bordered(inside, None, None))
