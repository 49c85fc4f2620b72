"""Splines and singular functions together: u = sum_j c_j N_j + sum_k s_k psi_k, with the unknowns s_k behind the c_j.

The stabilisation, derivatives along normals and differences of coefficients, concerns the splines alone: psi_k is
constant along normals.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.sparse import block_array, block_diag, csc_array, eye_array, hstack

from cpmkit.errors import SceneError
from cpmkit.forms.galerkin.conditions.condition_terms import ConditionTerms
from cpmkit.forms.galerkin.enrichment.singular_functions import SingularFunction
from cpmkit.forms.galerkin.space.function_space import FunctionSpace
from cpmkit.forms.galerkin.space.spline_space import derivative_rows, value_rows
from cpmkit.linear.multigrid.solver import Level
from cpmkit.types import Floats, Ints, SparseMatrix


@dataclass(frozen=True, eq=False)
class EnrichedSpace(FunctionSpace):
    """Splines of one spacing, and singular functions at the ends of boundaries."""

    functions: Sequence[SingularFunction]  #: The m functions psi_k, one or more.

    @property
    def size(self) -> int:
        """Number of unknowns, n + m."""
        return self.spline_count + len(self.functions)

    # Evaluation

    def singular_rows(self, points: Floats, cells: Ints) -> SparseMatrix:
        """Return the values (k, m) of the psi at ``points`` (k, d), which lie in the mesh ``cells`` (k,)."""
        return self._columns([function.values(points, cells) for function in self.functions], len(points))

    def singular_derivative_rows(self, points: Floats, cells: Ints, directions: Floats) -> SparseMatrix:
        """Return derivatives (k, m) of the psi along ``directions`` (k, d) at ``points`` (k, d) in ``cells`` (k,)."""
        columns = []
        for function in self.functions:
            rows, gradients = function.slopes(points, cells)
            columns.append((rows, np.einsum("kd,kd->k", gradients, directions[rows])))
        return self._columns(columns, len(points))

    def value_rows(self, patch: Ints, points: Floats, cells: Ints) -> SparseMatrix:
        """Return the matrix (k, n + m) that evaluates u at ``points`` (k, d) in the given patches and cells (k,)."""
        return hstack([self.spline_rows(patch, points), self.singular_rows(points, cells)], format="csr")

    def further_gradient_rows(self, points: Floats, cells: Ints) -> Sequence[SparseMatrix]:
        """Return d matrices (k, m): derivatives of the psi along each axis at ``points`` (k, d) in ``cells`` (k,)."""
        axes = np.eye(self.dof_map.dim)
        return [self.singular_derivative_rows(points, cells, np.broadcast_to(axis, points.shape)) for axis in axes]

    def values_at_samples(self, u: Floats, rows: slice | Ints | None = None) -> Floats:
        """Return the values (p, channels) of u at the samples of the manifold, or at the samples ``rows`` (p,)."""
        singular = self._singular_at_samples
        singular = singular if rows is None else singular[rows]
        return np.asarray(super().values_at_samples(u, rows) + singular @ u[self.spline_count :])

    def gradients_at_samples(self, u: Floats) -> Floats:
        """Return the tangential gradients (p, channels, d) of u at the samples of the manifold."""
        singular = [rows @ u[self.spline_count :] for rows in self._singular_gradients_at_samples]
        return np.asarray(self.spline_gradients_at_samples(u) + np.stack(singular, axis=-1))

    @cached_property
    def _psi_in_discs(self) -> list[tuple[Ints, Floats, Floats]]:
        """For each psi: the samples (k,) in its disc, its values (k,) and its tangential gradients (k, d) there."""
        samples, count = self.splines.samples, self.interior
        points, normals, cells = samples.points[:count], samples.normals[:count], samples.cell[:count]
        values = []
        for function in self.functions:
            rows, psi = function.values(points, cells)
            gradients = function.slopes(points, cells)[1]
            normal_parts = np.einsum("kcd,kd->kc", normals[rows], gradients)
            values.append((rows, psi, gradients - np.einsum("kcd,kc->kd", normals[rows], normal_parts)))
        return values

    @property
    def _singular_at_samples(self) -> SparseMatrix:
        """(p, m) the values of the psi at the samples of the manifold."""
        return self._columns([(rows, psi) for rows, psi, _ in self._psi_in_discs], self.interior)

    @property
    def _singular_gradients_at_samples(self) -> list[SparseMatrix]:
        """The d matrices (p, m) with the tangential gradients of the psi at the samples of the manifold."""
        return [
            self._columns([(rows, gradients[:, axis]) for rows, _, gradients in self._psi_in_discs], self.interior)
            for axis in range(self.dof_map.dim)
        ]

    def _columns(self, columns: Sequence[tuple[Ints, Floats]], count: int) -> SparseMatrix:
        """Return the matrix (count, m) with the given rows (k,) and entries (k,) of each column."""
        starts = np.cumsum([0, *(len(rows) for rows, _ in columns)])
        rows = np.concatenate([np.zeros(0, dtype=np.int64), *(rows for rows, _ in columns)])
        entries = np.concatenate([np.zeros(0), *(entries for _, entries in columns)])
        return csc_array((entries, rows, starts), shape=(count, len(columns))).tocsr()

    # Integrals

    def load(self, values: Floats) -> Floats:
        """Return the integrals (n + m, k) of ``values`` (p, k) at the samples of the manifold times each function."""
        weighted = self.splines.samples.weights[: self.interior, None] * values
        return np.concatenate([super().load(values), self._singular_at_samples.T @ weighted])

    def gradient_load(self, values: Floats) -> Floats:
        """Return the integrals (n + m,) of vectors (p, d) at samples times the tangential gradient of each function."""
        weighted = self.splines.samples.weights[: self.interior, None] * values
        singular = sum(rows.T @ weighted[:, axis] for axis, rows in enumerate(self._singular_gradients_at_samples))
        return np.concatenate([super().gradient_load(values), singular])

    def weighted_mass(self, c: Floats) -> SparseMatrix:
        """Raise a SceneError: singular functions are not implemented for coupled channels."""
        raise SceneError("tips='singular' takes no channels that are tied to each other; use tips='extended'.")

    def extend_matrix(self, matrix: SparseMatrix, a: Floats | None, c: Floats | None) -> SparseMatrix:
        """Return the ``matrix`` (n, n) of the splines plus the integrals of a grad u . grad v + c u v with the psi.

        The result is (n + m, n + m). ``a`` and ``c`` are (q,), at all samples, or (1,); None stands for no such term.
        """
        m = len(self.functions)
        mixed, singular = np.zeros((self.spline_count, m)), np.zeros((m, m))
        dof_map, samples = self.dof_map, self.splines.samples
        of_gradients, of_values = (None if factor is None else samples.weights * factor for factor in (a, c))
        for k, (rows, psi, gradients) in enumerate(self._psi_in_discs):
            at = dof_map, dof_map.patch[rows], samples.points[rows]
            if of_gradients is not None:
                mixed[:, k] += derivative_rows(*at, gradients).T @ of_gradients[rows]
            if of_values is not None:
                mixed[:, k] += value_rows(*at).T @ (of_values[rows] * psi)
        terms = (of_gradients, self._singular_gradients_at_samples), (of_values, [self._singular_at_samples])
        for weights, matrices in terms:
            if weights is not None:
                singular += sum((rows.T @ (rows * weights[: self.interior, None])).toarray() for rows in matrices)
        return block_array([[matrix, mixed], [mixed.T, singular]], format="csr")

    def extend_conditions(self, terms: ConditionTerms) -> ConditionTerms:
        """Return the ``terms`` of conditions for the splines as terms for the splines and the psi."""
        points, cells = terms.samples.points, terms.samples.cell
        slopes = self.singular_derivative_rows(points, cells, terms.samples.conormals)
        return replace(
            terms,
            values=hstack([terms.values, self.singular_rows(points, cells)], format="csr"),
            slopes=hstack([terms.slopes, slopes], format="csr"),
        )

    # Coarser levels

    @cached_property
    def plain_levels(self) -> list[Level]:
        """The multigrid levels of coarser lattices, on which the s_k remain unknowns, solved for with the strip."""
        m, levels = len(self.functions), []
        for level in super().plain_levels:
            prolongation = block_diag([level.prolongation, eye_array(m)], format="csr")
            strip = np.concatenate([level.strip, level.prolongation.shape[0] + np.arange(m)])
            levels.append(Level(prolongation, strip, lines=level.lines))
        return levels
