"""Splines and singular functions together: u = sum_j c_j N_j + sum_k s_k psi_k, with the unknowns s_k behind the c_j.

The stabilisation penalises the splines alone, since psi_k is constant along normals.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.sparse import block_array, block_diag, csc_array, csr_array, eye_array, hstack, vstack

from cpmkit.errors import SceneError
from cpmkit.forms.galerkin.conditions.condition_terms import ConditionTerms
from cpmkit.forms.galerkin.enrichment.plane_tips import TipSamples
from cpmkit.forms.galerkin.enrichment.singular_functions import SingularFunction
from cpmkit.forms.galerkin.space.function_space import FunctionSpace
from cpmkit.forms.galerkin.space.spline_space import derivative_rows, value_rows
from cpmkit.linear.multigrid.solver import Level
from cpmkit.types import Floats, Ints, SparseMatrix


@dataclass(frozen=True, eq=False)
class ProductRule:
    """A quadrature of products with singular functions."""

    points: Floats  #: (k, d), relative to the lattice's origin.
    patch: Ints  #: (k,): the patches whose splines are evaluated.
    weights: Floats  #: (k,).
    take: SparseMatrix  #: (k, p): the values at the points from those at the samples of the manifold.
    #: For each psi the points (r,) in its disc, its values (r,) and its tangential gradients (r, d) there.
    psi: Sequence[tuple[Ints, Floats, Floats]]


@dataclass(frozen=True, eq=False)
class EnrichedSpace(FunctionSpace):
    """Splines of one spacing, and singular functions at the ends of boundaries."""

    functions: Sequence[SingularFunction]  #: The m functions psi_k, one or more.
    near: TipSamples | None = None  #: The quadrature near tips in place of samples; in plane solids.

    @property
    def size(self) -> int:
        """Number of unknowns, n + m."""
        return self.spline_count + len(self.functions)

    def singular_rows(self, points: Floats, cells: Ints) -> SparseMatrix:
        """Return the values (k, m) of the functions psi at ``points`` (k, d) in the mesh ``cells`` (k,)."""
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
        """For each psi: the samples (k,) in its disc, its values (k,) and its tangential gradients (k, d) there.

        In patches near tips, see :attr:`near`, a constant is added to the values: their sum is the integral of psi.
        """
        samples, count = self.splines.samples, self.interior
        points, normals, cells = samples.points[:count], samples.normals[:count], samples.cell[:count]
        found = [_values_and_slopes(function, points, normals, cells) for function in self.functions]
        if self.near is None:
            return found
        weights, patch, of_rule = samples.weights[:count], self.dof_map.patch[:count], self._rule
        is_near, volumes = np.isin(patch, self.near.replaced), np.bincount(patch, weights)
        shifted = []
        for (rows, psi, gradients), (own, at_points, _) in zip(found, of_rule.psi, strict=True):
            values, slopes = np.zeros(count), np.zeros((count, points.shape[1]))
            values[rows], slopes[rows] = psi, gradients
            sums = np.bincount(of_rule.patch[own], of_rule.weights[own] * at_points, len(volumes))
            shift = (sums - np.bincount(patch, weights * values, len(volumes))) / volumes
            values[is_near] += shift[patch[is_near]]
            kept = np.union1d(rows, np.flatnonzero(is_near))
            shifted.append((kept, values[kept], slopes[kept]))
        return shifted

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

    @cached_property
    def _rule(self) -> ProductRule:
        """The quadrature of products with the psi."""
        samples, count = self.splines.samples, self.interior
        cells = np.unique(np.concatenate([function.disc.cells for function in self.functions]))
        cells = cells if self.near is None else np.setdiff1d(cells, self.near.replaced)
        rows = np.flatnonzero(np.isin(samples.cell[:count], cells))
        take = csr_array((np.ones(len(rows)), rows, np.arange(len(rows) + 1)), shape=(len(rows), count))
        points, normals = samples.points_at(rows), samples.normals_at(rows)
        patch, cell, weights = self.dof_map.patch[rows], samples.cell_at(rows), samples.weights[rows]
        if self.near is not None:
            near = self.near
            points, weights = np.concatenate([points, near.points]), np.concatenate([weights, near.weights])
            patch, cell = (np.concatenate([each, near.patch]) for each in (patch, cell))
            normals = np.zeros((len(points), *normals.shape[1:]))
            take = vstack([take, near.from_samples], format="csr")
        psi = [_values_and_slopes(function, points, normals, cell) for function in self.functions]
        return ProductRule(points, patch, weights, take, psi)

    def load(self, values: Floats) -> Floats:
        """Return the integrals (n + m, k) of ``values`` (p, k) at the samples of the manifold times each function."""
        rule, singular = self._rule, []
        weighted = rule.weights[:, None] * (rule.take @ values)
        for rows, psi, _ in rule.psi:
            singular.append(psi @ weighted[rows])
        return np.concatenate([super().load(values), np.stack(singular)])

    def gradient_load(self, values: Floats) -> Floats:
        """Return the integrals (n + m,) of vectors (p, d) at samples times the tangential gradient of each function."""
        rule = self._rule
        weighted = rule.weights[:, None] * (rule.take @ values)
        singular = [np.sum(gradients * weighted[rows]) for rows, _, gradients in rule.psi]
        return np.concatenate([super().gradient_load(values), singular])

    def weighted_mass(self, c: Floats) -> SparseMatrix:
        """Raise a SceneError: singular functions are not implemented for coupled channels."""
        raise SceneError("tips='singular' takes no channels that are tied to each other; use tips='extended'.")

    def extend_matrix(self, matrix: SparseMatrix, a: Floats | None, c: Floats | None) -> SparseMatrix:
        """Return the ``matrix`` (n, n) of the splines plus the integrals of a grad u . grad v + c u v with the psi.

        The result is (n + m, n + m). ``a`` and ``c`` are (q,), at all samples, or (1,); None stands for no such term.
        """
        m, rule = len(self.functions), self._rule
        mixed, singular = np.zeros((self.spline_count, m)), np.zeros((m, m))
        for factor, is_gradient in ((a, True), (c, False)):
            if factor is None:
                continue
            at_points = factor if len(factor) == 1 else rule.take @ factor[: self.interior]
            weights, columns = rule.weights * at_points, []
            for k, (rows, psi, gradients) in enumerate(rule.psi):
                at = self.dof_map, rule.patch[rows], rule.points[rows]
                of_splines = derivative_rows(*at, gradients) if is_gradient else value_rows(*at) * psi[:, None]
                mixed[:, k] += of_splines.T @ weights[rows]
                values = np.zeros((len(rule.points), gradients.shape[1] if is_gradient else 1))
                values[rows] = gradients if is_gradient else psi[:, None]
                columns.append(values.ravel())
            products = np.stack(columns)
            singular += (products * np.repeat(weights, products.shape[1] // len(weights))) @ products.T
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

    @cached_property
    def plain_levels(self) -> list[Level]:
        """The multigrid levels of coarser lattices, on which the s_k remain unknowns, solved for with the strip."""
        m, levels = len(self.functions), []
        for level in super().plain_levels:
            prolongation = block_diag([level.prolongation, eye_array(m)], format="csr")
            strip = np.concatenate([level.strip, level.prolongation.shape[0] + np.arange(m)])
            levels.append(Level(prolongation, strip, lines=level.lines))
        return levels


def _values_and_slopes(
    function: SingularFunction, points: Floats, normals: Floats, cells: Ints
) -> tuple[Ints, Floats, Floats]:
    """Return the ``points`` (k,) in a disc, and the values (k,) and tangential gradients (k, d) of its function."""
    rows, psi = function.values(points, cells)
    gradients = function.slopes(points, cells)[1]
    normal_parts = np.einsum("kcd,kd->kc", normals[rows], gradients)
    return rows, psi, gradients - np.einsum("kcd,kc->kd", normals[rows], normal_parts)
