"""The space of discrete functions: splines of one spacing, and projection onto them; other spaces derive from it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from cpmkit.forms.galerkin.dof_map import DofMap
from cpmkit.forms.galerkin.options import Stabilisation
from cpmkit.forms.galerkin.space import energy
from cpmkit.forms.galerkin.space.levels import coarser_levels
from cpmkit.forms.galerkin.space.spline_space import SplineSpace, derivative_rows, value_rows
from cpmkit.linear.constant_functions import RowGroups
from cpmkit.linear.csr_matrices import UnsignedCsr
from cpmkit.linear.direct import factorize_matrix
from cpmkit.linear.krylov import conjugate_gradients
from cpmkit.linear.multigrid.solver import Level
from cpmkit.linear.operators import CsrOperator
from cpmkit.runtime.memory import state_without_cached
from cpmkit.types import Floats, Ints, SparseMatrix, no_progress

if TYPE_CHECKING:
    from cpmkit.forms.galerkin.conditions.condition_terms import ConditionTerms


@dataclass(frozen=True, eq=False)
class FunctionSpace:
    """Functions u = sum_j c_j N_j on the manifold, with N_j the splines of the lattice.

    The unknowns are the n coefficients c_j. In refined spaces the functions are linear combinations of N other splines,
    in :attr:`splines`: the prolongation R (N, spline_count) maps the unknowns to the coefficients of these splines. In
    enriched spaces further unknowns follow the c_j.
    """

    splines: SplineSpace  #: The splines that are evaluated and integrated, with their q samples.
    interior: int  #: Number p of the samples on the manifold, which precede those on boundaries.
    stabilisation: Stabilisation  #: Factors of the stabilisation.

    __getstate__ = state_without_cached

    @property
    def dof_map(self) -> DofMap:
        """The dof map of :attr:`splines`: the patches of the samples, and the splines that each patch reads."""
        return self.splines.dof_map

    @property
    def base_dof_map(self) -> DofMap:
        """The dof map of the lattice without refinement; the connected pieces of the manifold are counted in it."""
        return self.dof_map

    @property
    def spacing(self) -> float:
        """The spacing h of the lattice."""
        return self.dof_map.spacing

    @property
    def finest_spacing(self) -> float:
        """The smallest spacing of the splines in the space."""
        return self.spacing

    @property
    def spline_count(self) -> int:
        """Number of unknowns that are coefficients of splines; these precede all other unknowns."""
        return self.dof_map.size

    @property
    def size(self) -> int:
        """Number of unknowns, n."""
        return self.spline_count

    @property
    def constant(self) -> Floats:
        """The unknowns (n, 1) of the constant function 1: 1 for splines, which sum to 1, and 0 for other functions."""
        return (np.arange(self.size) < self.spline_count).astype(np.float64)[:, None]

    def to_coefficients(self, u: Floats) -> Floats:
        """Return the coefficients R u (N, k) of :attr:`splines` for the unknowns ``u`` (n, k)."""
        return u[: self.spline_count]

    def restrict_loads(self, loads: Floats) -> Floats:
        """Return R' ``loads`` (spline_count, k) from the loads (N, k) of :attr:`splines`."""
        return loads

    def restrict_matrix(self, matrix: SparseMatrix) -> SparseMatrix:
        """Return R' A R (spline_count, spline_count) from a ``matrix`` A (N, N) over :attr:`splines`."""
        return matrix

    def restrict_rows(self, rows: SparseMatrix) -> SparseMatrix:
        """Return ``rows`` R (k, spline_count) from rows (k, N) that evaluate :attr:`splines`."""
        return rows

    def spline_rows(self, patch: Ints, points: Floats) -> SparseMatrix:
        """Return the matrix (k, spline_count) that evaluates the splines at ``points`` (k, d) in patches (k,)."""
        return self.restrict_rows(value_rows(self.dof_map, patch, points))

    def spline_derivative_rows(self, patch: Ints, points: Floats, directions: Floats) -> SparseMatrix:
        """Return the matrix (k, spline_count) of derivatives along ``directions``, at points (k, d) in patches (k,)."""
        return self.restrict_rows(derivative_rows(self.dof_map, patch, points, directions))

    def value_rows(self, patch: Ints, points: Floats, cells: Ints) -> SparseMatrix:
        """Return the matrix (k, n) that evaluates u at ``points`` (k, d) in patches (k,) and mesh ``cells`` (k,)."""
        del cells  # used by spaces with functions beside the splines
        return self.spline_rows(patch, points)

    def further_gradient_rows(self, points: Floats, cells: Ints) -> Sequence[SparseMatrix]:
        """Return d matrices (k, n - spline_count) that evaluate the gradient of the functions beside the splines.

        There is one for each component, at ``points`` (k, d) in mesh ``cells`` (k,); none if there are only splines.
        """
        del points, cells
        return ()

    def values_at_samples(self, u: Floats, rows: slice | Ints | None = None) -> Floats:
        """Return the values (p, channels) of u at the samples on the manifold, or at the samples ``rows``."""
        return energy.values_at_samples(
            self.splines, self.to_coefficients(u), slice(self.interior) if rows is None else rows
        )

    def spline_gradients_at_samples(self, u: Floats) -> Floats:
        """Return the tangential gradients (p, channels, d) of the spline part of u at the samples on the manifold."""
        return energy.gradients_at_samples(self.splines, self.to_coefficients(u), slice(self.interior))

    def gradients_at_samples(self, u: Floats) -> Floats:
        """Return the tangential gradients (p, channels, d) of u at the samples on the manifold."""
        return self.spline_gradients_at_samples(u)

    @cached_property
    def spline_integrals(self) -> Floats:
        """The integrals (spline_count,) of each spline over the manifold."""
        return self.spline_loads(np.ones((1, 1)))[:, 0]

    def spline_loads(self, values: Floats) -> Floats:
        """Return the integrals (spline_count, k) of ``values``, (q, k) at all samples or (1, k), times each spline."""
        return self.restrict_loads(energy.load(self.splines, values))

    def load(self, values: Floats) -> Floats:
        """Return the integrals (n, k) of ``values`` (p, k) at the samples on the manifold times each function."""
        count = len(self.splines.samples) - self.interior
        return self.spline_loads(np.concatenate([values, np.zeros((count, values.shape[1]))]) if count else values)

    def gradient_load(self, values: Floats) -> Floats:
        """Return the integrals (n,) of a vector field (p, d) at the samples times the gradient of each function."""
        return energy.gradient_load(self.splines, values)

    @cached_property
    def mass(self) -> CsrOperator:
        """The mass matrix M (n, n) of the functions; it is singular, as some splines are zero at all samples."""
        matrix = self.restrict_matrix(energy.mass(self.splines, 1.0))
        return CsrOperator(self.extend_matrix(matrix, None, np.ones(1)), symmetric=True)

    def weighted_mass(self, c: Floats) -> SparseMatrix:
        """Return the mass matrix (spline_count, spline_count) of the splines, weighted with ``c`` (q,) at samples."""
        return self.restrict_matrix(energy.mass(self.splines, c))

    def stiffness(self, a: Floats, c: Floats | None, scale: Floats | None = None) -> SparseMatrix:
        """Return the integrals of a grad u . grad v + c u v over the splines, with stabilisation and floor.

        At the samples ``a`` is (q,), (q, d, d) or (1,), ``c`` (q,) or (1,), and ``scale`` (q,) the coefficient to which
        stabilisation and floor are proportional, by default ``a``.
        """
        return self.restrict_matrix(energy.stiffness_with_floor(self.splines, a, self.stabilisation, c, scale))

    def extend_matrix(self, matrix: SparseMatrix, a: Floats | None, c: Floats | None) -> SparseMatrix:
        """Return a ``matrix`` over the splines extended by the functions beside the splines, (n, n).

        Its further entries are the integrals of a grad u . grad v + c u v, a and c (q,) or (1,), None for no such term.
        """
        del a, c
        return matrix

    def extend_conditions(self, terms: ConditionTerms) -> ConditionTerms:
        """Return the ``terms`` of conditions, given in the coefficients of the splines, in all unknowns."""
        return terms

    @cached_property
    def projection_matrix(self) -> SparseMatrix:
        """The positive definite matrix M + h^2 S (n, n), S the stabilisation for diffusivity 1; h is h_l on level l.

        The mass matrix M alone is singular, since some splines are zero at all samples; S determines their
        coefficients.
        """
        return self.stabilised_mass(np.ones(1))

    def stabilised_mass(self, b: Floats) -> SparseMatrix:
        """Return M + h^2 S (n, n) weighted with ``b``, (q,) at samples or (1,); see :attr:`projection_matrix`."""
        data = energy.stabilisation_data(self.splines, b, self.stabilisation)
        smaller = b * self.dof_map.magnification(self.dof_map.patch) ** -2.0  # (h_l / h)^2
        energy.add_ghosts(self.splines, smaller, self.stabilisation, data)
        penalty = self.extend_matrix(self.restrict_matrix(self.splines.matrix(data)), None, None)
        if len(b) == 1:
            return (b[0] * self.mass.matrix + self.spacing**2 * penalty).tocsr()
        mass = self.extend_matrix(self.restrict_matrix(energy.mass(self.splines, b)), None, b)
        return (mass + self.spacing**2 * penalty).tocsr()

    @cached_property
    def _compiled_projection(self) -> UnsignedCsr:
        """The projection matrix in the format whose product with vectors is compiled."""
        return UnsignedCsr.from_matrix(self.projection_matrix)

    @cached_property
    def pieces(self) -> RowGroups:
        """The functions of each connected component of the projection matrix."""
        from scipy.sparse.csgraph import connected_components

        return RowGroups.from_numbers(*connected_components(self.projection_matrix, directed=False))

    def solve_projection(self, loads: Floats) -> Floats:
        """Return the solutions u (n, k) of (M + h^2 S) u = ``loads``, to relative residuals of 1e-13.

        ``loads`` (n, k) are integrals of k functions times each function of the space. The condition number is below
        200 at any spacing, or up to 1e9 with charts of few triangles: diagonally preconditioned conjugate gradients are
        faster than a factorisation, which is used if they do not converge.
        """
        from scipy.sparse import diags_array

        u, inverse_diagonal = np.zeros_like(loads), 1 / self.projection_matrix.diagonal()[:, None]
        columns = np.flatnonzero(np.any(loads != 0, axis=0))
        if len(columns):
            # Each piece of the manifold in a unit of its own, a power of two: small loads are as exact.
            groups = self.pieces
            size = groups.reduce_groups(np.maximum, np.abs(loads[:, columns]))
            unit = groups.spread_to_rows(np.ldexp(1.0, np.clip(np.frexp(size)[1], -1000, 1000)))
            b, apply = loads[:, columns] / unit, self._compiled_projection.apply
            target, most = 1e-13 * np.linalg.norm(b, axis=0), 1_000  # 130 to 190 steps are usual
            x, steps = conjugate_gradients(apply, lambda r: inverse_diagonal * r, b, target, most, no_progress)
            if steps == most:
                # A function that is zero at all samples of a chart makes the matrix singular, not the values there.
                shifted = self.projection_matrix + diags_array(1e-13 / inverse_diagonal[:, 0])
                x = factorize_matrix(shifted, symmetric_pattern=True).solve(b)
            u[:, columns] = x * unit
        return u

    def project(self, values: Floats) -> Floats:
        """Return the unknowns (n, k) of the L2 projections of ``values`` (p, k) at the samples on the manifold."""
        return self.solve_projection(self.load(values))

    @cached_property
    def plain_levels(self) -> list[Level]:
        """The multigrid levels of coarser lattices, with prolongations: of twice the spacing, four times, and so on.

        The smoother solves exactly, in blocks, for the unknowns of the strip: in a solid in space those of its thin
        parts. There, values on the skin determine u but for a remainder that is not smooth, which coarser levels do not
        approximate. Elsewhere in a solid factors would be large without saving iterations.
        """
        if self.splines.samples.codim or self.dof_map.dim < 3:
            return coarser_levels(self.base_dof_map, self.base_dof_map.patch[self.interior :])
        thin = np.flatnonzero(energy.thickness_of_patches(self.splines) < 1)
        return coarser_levels(self.base_dof_map, thin, in_blocks=True)

    @cached_property
    def refined_levels(self) -> list[Level]:
        """The multigrid levels between refined spaces, which precede :attr:`plain_levels`; none without refinement."""
        return []

    def describe(self) -> dict[str, Any]:
        """Return the entries that describe the space in reports, as plain values; none here."""
        return {}

    def arrays(self) -> dict[str, Any]:
        """Return the arrays that are saved with a solution, from which :meth:`differs_from` compares spaces."""
        return {"nodes": self.base_dof_map.nodes}

    def differs_from(self, saved: Mapping[str, Any]) -> str:
        """Return in words how this space differs from that of ``saved`` :meth:`arrays` of a solution; "" if equal."""
        return "" if np.array_equal(self.base_dof_map.nodes, saved["nodes"]) else "its nodes are others"
