"""Constants taken out of a linear system: a relative residual then compares to what varies, wherever zero lies.

With K the functions that are constant and c the least squares solution of ``A K c = b``, ``A v = b - A K c`` is solved
and ``u = v + K c``. Where u is a large constant and a small variation, b is nearly ``A K c``; a residual relative to b
would be as large as the variation. Sets of unknowns that A does not couple, as of two spheres, are systems of their own
that are solved at once: each has its own constants, and is scaled so that a residual weighs as much in each.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cpmkit.linear.solve_report import SolveReport
from cpmkit.protocols import Floats, Ints, Operator, PreparedSolver, Progress, no_progress


@dataclass(frozen=True, eq=False)
class Groups:
    """Rows (n, ...) in groups, each of one row or more.

    Attributes
    ----------
    label : (n,) int64
        The group of each row, (1,) where there is one group.
    order : (n,) int64
        The rows, group by group; a slice of all where there is one group.
    starts : (groups,) int64
        Where each group begins in that order.
    """

    label: Ints
    order: Any
    starts: Ints

    @classmethod
    def of(cls, count: int, label: Ints) -> Groups:
        """Return ``count`` groups by the label of each row."""
        if count == 1:
            return cls(np.zeros(1, dtype=np.int64), slice(None), np.zeros(1, dtype=np.int64))
        order = np.argsort(label, kind="stable")
        members = np.bincount(label, minlength=count)
        return cls(label, order, np.cumsum(members) - members)

    def at(self, values: Any) -> Any:
        """Return of ``values`` (groups, ...) each row's, (n, ...), or (1, ...) where there is one group."""
        return values if len(self.starts) == 1 else values[self.label]

    def sums(self, rows: Any) -> Any:
        """Return the sums (groups, ...) of ``rows`` (n, ...)."""
        return self._reduced(np.add, rows)

    def products(self, left: Any, right: Any) -> Any:
        """Return the sums (groups, k, m) of products of columns of ``left`` (n, k) and ``right`` (n, m)."""
        if len(self.starts) == 1:
            return (left.T @ right)[None]
        return self.sums(left[:, :, None] * right[:, None])

    def norms(self, rows: Any) -> Floats:
        """Return the norms (groups, m) of the columns of ``rows`` (n, m)."""
        return np.asarray(np.sqrt(self.sums(np.abs(rows) ** 2)))

    def largest(self, rows: Any) -> Floats:
        """Return the largest absolute values (groups, m) in the columns of ``rows`` (n, m)."""
        return np.asarray(self._reduced(np.maximum, np.abs(rows)))

    def ranges(self, rows: Floats) -> Floats:
        """Return the ranges (groups, m) of the columns of ``rows`` (n, m)."""
        return np.asarray(self._reduced(np.maximum, rows) - self._reduced(np.minimum, rows))

    def _reduced(self, operation: np.ufunc, rows: Any) -> Any:
        return operation.reduceat(rows[self.order], self.starts, axis=0)


#: Constants are taken out where that leaves at most this share of b; else a relative residual means nearly the same.
MOST_LEFT = 0.5
#: Where b sums to less than this share of its size, quadrature may have made all of the sum.
CANCELLING_SHARE = 1e-6
#: Where ``K' A K`` is less than this share of its parts, rounding is much of it.
CANCELLED_SHARE = 1e-12
#: Exponents by which b is scaled lie between plus and minus this: powers of two that are neither zero nor infinite.
MOST_EXPONENT = 1000
#: A part of b below this share of it is rounding: no solver is to resolve it.
ROUNDING_SHARE = 4 * np.finfo(float).eps


@dataclass(frozen=True, eq=False)
class Constants:
    """The constants of an operator's unknowns.

    Attributes
    ----------
    functions : (n, c) float64
        K, functions that are constant, or zero on some unknowns; on each piece they have factors of their own.
    images : (n, c)
        A K.
    sizes : (pieces, c) float64
        ``K' |diag A| K`` of each piece: what ``K' A K`` would be, were its entries not to cancel.
    pieces : Groups
        The sets of unknowns that A couples among themselves alone.
    """

    functions: Floats
    images: Any
    sizes: Floats
    pieces: Groups

    @classmethod
    def of(cls, operator: Operator, functions: Floats) -> Constants:
        """Return those of an operator."""
        pieces = Groups.of(*operator.pieces())
        sizes = pieces.sums(np.abs(operator.diagonal) * functions**2)
        return cls(functions, operator.apply(functions), sizes, pieces)

    def solve(
        self,
        prepared: PreparedSolver,
        b: Any,
        tolerance: float,
        guess: Any = None,
        progress: Progress = no_progress,
    ) -> tuple[Any, SolveReport]:
        """Return u (n, channels) with ``A u = b``, and a report whose residual is relative to ``b - A K c``.

        Where that is so small that rounding of b is more than ``tolerance`` of it, the residual is relative to what
        makes this rounding ``tolerance``.

        Parameters
        ----------
        prepared : PreparedSolver
            Solves with A.
        b, tolerance, guess, progress
            As for ``prepared.solve``. Of b what rounding has left is not solved for.

        Raises
        ------
        ConvergenceError
            As ``prepared.solve`` does.
        """
        each, at = self.pieces, self.pieces.at
        exponent = _exponent(each.largest(b))  # scaled by powers of two, squares of b neither overflow nor vanish
        b = b * at(_powers(-exponent))
        size = each.norms(b)
        shares, rest = self._taken_out(b)
        left = each.norms(rest)
        kept = left > MOST_LEFT * size
        shares = np.where(kept[:, None], 0.0, shares)
        rest = np.where(at(kept), b, rest)
        left = np.where(kept, size, left)
        noise = ROUNDING_SHARE * size
        todo = left > noise
        allowed = np.where(todo, np.maximum(tolerance * left, noise), 0.0)
        level = np.where(todo, np.frexp(allowed)[1], 0)
        level -= np.max(level, axis=0, where=todo, initial=np.iinfo(level.dtype).min) * todo
        unit = _powers(-level)  # with which a residual weighs about the same in each piece, and rounding hides none
        rest = np.where(at(todo), rest * at(unit), 0.0)
        some = todo.any(axis=0)
        reached = (_norms(allowed * unit)[some] / _norms(left * unit * todo)[some]).min(initial=1.0)
        reached = max(tolerance, float(reached)) if some.any() else tolerance
        start = None
        if guess is not None:
            start = (guess * at(_powers(-exponent)) - self._constant(shares)) * at(unit)
        v, report = prepared.solve(rest, reached, start, progress)
        report = replace(report, residual=report.residual * (tolerance / reached), tolerance=tolerance)
        return (v * at(_powers(level)) + self._constant(shares)) * at(_powers(exponent)), report

    def _constant(self, shares: Any) -> Any:
        """Return K c for c (pieces, c, channels)."""
        return np.einsum("nk,nkc->nc", self.functions, self.pieces.at(shares))

    def _taken_out(self, b: Any) -> tuple[Any, Any]:
        """Return c (pieces, c, channels), and ``b - A K c``.

        By the normal equations of each piece, whose rounding the second of two steps takes out.
        """
        conjugate = self.images.conj()
        inverse = np.linalg.pinv(self.pieces.products(conjugate, self.images), hermitian=True)
        shares, rest = np.zeros(1), b
        for _ in range(2):
            shares = shares + inverse @ self.pieces.products(conjugate, rest)
            rest = b - np.einsum("nk,nkc->nc", self.images, self.pieces.at(shares))
        return shares, rest

    def chance(self, b: Floats, u: Floats) -> tuple[str, ...]:
        """Return a warning where the mean of u (n, channels) is a sum of b that cancels, over what is hardly known.

        That is where the mean is larger than the range, or where rounding is much of ``K' A K``.
        """
        each = self.pieces
        sums, sizes = np.abs(each.products(self.functions, b)), each.products(np.abs(self.functions), np.abs(b))
        own = each.sums(self.functions * self.images)[:, :, None]
        shift = np.divide(sums, np.abs(own), out=np.zeros_like(sums), where=own != 0)
        unknown = (np.abs(own) <= CANCELLED_SHARE * self.sizes[:, :, None]) | (shift > each.ranges(u)[:, None])
        felt = unknown & (sums <= CANCELLING_SHARE * sizes) & (sizes > 0)
        if not felt.any():
            return ()
        share = float((sums[felt] / sizes[felt]).max())
        return (
            f"The mean of the solution follows from a sum of f and the fluxes that cancels to {share:.1g} of their "
            "size, divided by a small c: quadrature and rounding decide it, and the rest of the solution alone is "
            "right; use c=0, for a mean of zero, or a larger c.",
        )


def _exponent(size: Any) -> Any:
    """Return the exponent of the power of two that is about this size, 0 where that is zero."""
    return np.clip(np.frexp(size)[1], -MOST_EXPONENT, MOST_EXPONENT)


def _powers(exponent: Any) -> Floats:
    return np.asarray(np.ldexp(1.0, exponent))


def _norms(columns: Any) -> Floats:
    return np.asarray(np.linalg.norm(columns, axis=0))
