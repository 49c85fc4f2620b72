"""Separation of the constant part of a solution, so that a relative residual measures the part that varies.

With K the functions that are constant and c the least squares solution of ``A K c = b``, ``A v = b - A K c`` is solved
and ``u = v + K c``. Where u is a large constant plus a small variation, b is nearly ``A K c``, and a residual that is
small relative to b could be as large as the variation. Connected components of A, as of two spheres, are solved at
once: each has its own constants, and is scaled so that residuals have about the same weight in each.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cpmkit.linear.operators import Operator, PreparedSolver
from cpmkit.linear.residuals import SolveReport
from cpmkit.types import Floats, Ints, Progress, no_progress


@dataclass(frozen=True, eq=False)
class RowGroups:
    """Groups of the rows of arrays (n, ...), each with one row or more."""

    label: Ints  #: (n,): number of the group of each row; shape (1,) if there is one group.
    order: Any  #: (n,) int64: the rows sorted by group; a slice if there is one group.
    starts: Ints  #: (groups,): position in ``order`` of the first row of each group.

    @classmethod
    def from_numbers(cls, count: int, label: Ints) -> RowGroups:
        """Return ``count`` groups of rows from the group number (n,) of each row, 0 to ``count`` - 1."""
        if count == 1:
            return cls(np.zeros(1, dtype=np.int64), slice(None), np.zeros(1, dtype=np.int64))
        order = np.argsort(label, kind="stable")
        members = np.bincount(label, minlength=count)
        return cls(label, order, np.cumsum(members) - members)

    def spread_to_rows(self, values: Any) -> Any:
        """Return for each row its group's entry of ``values`` (groups, ...): (n, ...), or (1, ...) for one group."""
        return values if len(self.starts) == 1 else values[self.label]

    def sums(self, rows: Any) -> Any:
        """Return the sums (groups, ...) of ``rows`` (n, ...) by group."""
        return self.reduce_groups(np.add, rows)

    def inner_products(self, left: Any, right: Any) -> Any:
        """Return ``left' right`` (groups, k, m) for the rows of each group of ``left`` (n, k) and ``right`` (n, m)."""
        if len(self.starts) == 1:
            return (left.T @ right)[None]
        return self.sums(left[:, :, None] * right[:, None])

    def norms(self, rows: Any) -> Floats:
        """Return the Euclidean norms (groups, m) of the columns of ``rows`` (n, m), by group."""
        return np.asarray(np.sqrt(self.sums(np.abs(rows) ** 2)))

    def reduce_groups(self, operation: np.ufunc, rows: Any) -> Any:
        """Return ``rows`` (n, ...) reduced over each group by ``operation``, such as np.maximum: (groups, ...)."""
        return operation.reduceat(rows[self.order], self.starts, axis=0)


#: A remainder below this share of b is rounding, and is not solved for.
ROUNDING_SHARE = 4 * np.finfo(float).eps


@dataclass(frozen=True, eq=False)
class ConstantFunctions:
    """The functions of an operator's unknowns that are constant, and the solution of systems with these separated."""

    #: (n, k): K, functions that are constant or zero; each connected component of A has separate coefficients of them.
    functions: Floats
    images: Any  #: (n, k): A K.
    sizes: Floats  #: (pieces, k): ``K' |diag A| K`` of each component: the size of ``K' A K`` without cancellation.
    pieces: RowGroups  #: The connected components of A.

    @classmethod
    def from_functions(cls, operator: Operator, functions: Floats) -> ConstantFunctions:
        """Return K, the ``functions`` (n, k) that are constant or zero, with A K and A's connected components."""
        pieces = RowGroups.from_numbers(*operator.pieces())
        sizes = pieces.sums(np.abs(operator.diagonal) * functions**2)
        return cls(functions, operator.apply(functions), sizes, pieces)

    def solve(
        self, prepared: PreparedSolver, b: Any, tolerance: float, guess: Any = None, progress: Progress = no_progress
    ) -> tuple[Any, SolveReport]:
        """Return u (n, channels) with ``A u = b``, and a report whose residual is relative to ``b - A K c``.

        c is the least squares solution of ``A K c = b`` in each component, but 0 if the rest, ``b - A K c``, is over
        half of b. If the rest is rounding, u is K c. If rounding of b exceeds ``tolerance`` times the rest, the system
        is solved only to that rounding, and the reported residual is multiplied by ``tolerance`` over the tolerance
        used. ``prepared`` solves for A from ``guess``, an initial u or None, and may raise ConvergenceError.
        """
        each, at = self.pieces, self.pieces.spread_to_rows
        # By powers of two, so that squares of b neither overflow nor vanish.
        exponent = np.clip(np.frexp(each.reduce_groups(np.maximum, np.abs(b)))[1], -1000, 1000)
        b = b * at(np.ldexp(1.0, -exponent))
        size = each.norms(b)
        shares, rest = self._separate_constants(b)
        remaining = each.norms(rest)
        whole = remaining > 0.5 * size  # then the residual relative to b differs little
        shares = np.where(whole[:, None], 0.0, shares)
        rest = np.where(at(whole), b, rest)
        remaining = np.where(whole, size, remaining)
        noise = ROUNDING_SHARE * size
        unsolved = remaining > noise
        allowed = np.where(unsolved, np.maximum(tolerance * remaining, noise), 0.0)
        level = np.where(unsolved, np.frexp(allowed)[1], 0)
        level -= np.max(level, axis=0, where=unsolved, initial=np.iinfo(level.dtype).min) * unsolved
        unit = np.ldexp(1.0, -level)  # residuals have about the same weight in each component
        rest = np.where(at(unsolved), rest * at(unit), 0.0)
        some = unsolved.any(axis=0)
        sizes = (np.linalg.norm(part * unit, axis=0)[some] for part in (allowed, remaining * unsolved))
        reached = np.divide(*sizes).min(initial=1.0)
        reached = max(tolerance, float(reached)) if some.any() else tolerance
        start = None
        if guess is not None:
            start = (guess * at(np.ldexp(1.0, -exponent)) - self._constant_part(shares)) * at(unit)
        v, report = prepared.solve(rest, reached, start, progress)
        report = replace(report, residual=report.residual * (tolerance / reached), tolerance=tolerance)
        return (v * at(np.ldexp(1.0, level)) + self._constant_part(shares)) * at(np.ldexp(1.0, exponent)), report

    def _constant_part(self, shares: Any) -> Any:
        """Return K c (n, channels) for the coefficients c (pieces, k, channels) of the k constant functions."""
        return np.einsum("nk,nkc->nc", self.functions, self.pieces.spread_to_rows(shares))

    def _separate_constants(self, b: Any) -> tuple[Any, Any]:
        """Return the least squares solution c (pieces, k, channels) of ``A K c = b``, and ``b - A K c`` (n, channels).

        c solves the normal equations of each component for b (n, channels), then for the rest, against rounding.
        """
        conjugate = self.images.conj()
        inverse = np.linalg.pinv(self.pieces.inner_products(conjugate, self.images), hermitian=True)
        shares, rest = np.zeros(1), b
        for _ in range(2):
            shares = shares + inverse @ self.pieces.inner_products(conjugate, rest)
            rest = b - np.einsum("nk,nkc->nc", self.images, self.pieces.spread_to_rows(shares))
        return shares, rest

    def cancellation_warnings(self, b: Floats, u: Floats) -> tuple[str, ...]:
        """Return a warning in a tuple if the mean of u (n, channels) is a quotient of two sums that cancel; else ().

        The numerator ``K' b``, b (n, channels), counts as cancelled below 1e-6 of its terms; ``K' A K`` below 1e-12, or
        if the resulting mean is larger than the range of u, the solution of ``A u = b``.
        """
        each = self.pieces
        sums = np.abs(each.inner_products(self.functions, b))
        sizes = each.inner_products(np.abs(self.functions), np.abs(b))
        denominators = each.sums(self.functions * self.images)[:, :, None]
        shift = np.divide(sums, np.abs(denominators), out=np.zeros_like(sums), where=denominators != 0)
        ranges = each.reduce_groups(np.maximum, u) - each.reduce_groups(np.minimum, u)
        unknown = (np.abs(denominators) <= 1e-12 * self.sizes[:, :, None]) | (shift > ranges[:, None])
        affected = unknown & (sums <= 1e-6 * sizes) & (sizes > 0)  # it may consist of quadrature error only
        if not affected.any():
            return ()
        share = float((sums[affected] / sizes[affected]).max())
        return (
            f"The mean of the solution follows from a sum of f and the fluxes that cancels to {share:.1g} of their "
            "size, divided by a small c: quadrature and rounding decide it, and the rest of the solution alone is "
            "right; use c=0, for a mean of zero, or a larger c.",
        )
