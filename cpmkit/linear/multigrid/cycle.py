"""A symmetric V cycle over a form's levels, with coarser operators P' A P."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import comb
from typing import TYPE_CHECKING

import numpy as np

from cpmkit.linear.csr_matrices import SymmetricCsr, UnsignedCsr, as_symmetric_csr, coarse_operator, in_float32
from cpmkit.linear.direct import IndefiniteError, PositiveFactors, SymmetricFactors
from cpmkit.linear.multigrid.smoothers import COARSER_SWEEPS, FINEST_SWEEPS, Chebyshev, GaussSeidel, Smoother, Strip
from cpmkit.runtime.memory import release_memory
from cpmkit.types import Floats, Ints

if TYPE_CHECKING:
    from scipy.sparse import csr_array


#: Factor of Lanczos' estimate of the largest eigenvalue, which is a lower bound.
EIGENVALUE_MARGIN = 1.1
#: A finest matrix with more entries is not rounded to float32: the rounded copy would be an eighth of the memory at the
#: peak, and save a tenth of the time of a solve.
MAX_ROUNDED_ENTRIES = 1 << 25
#: A diagonal entry below this share of the largest counts as zero: a piece of one unknown whose constant is free.
ZERO_DIAGONAL_SHARE = 1e-14
#: Largest ratio of diagonal entries for float32: above it a cycle becomes indefinite, as penalties on slivers between
#: close curves are so large that the stiffness next to them is lost by rounding.
MAX_DIAGONAL_RATIO = 1e6
#: Weight of the differences along a line, as a share of the largest diagonal entry on it: above rounding of float32.
LINE_STABILISATION = 1e-6


@dataclass(frozen=True, eq=False)
class Level:
    """One step from a finer level to the next coarser level; a form returns them from the finest on.

    Attributes
    ----------
    prolongation : csr_array (n, m)
        P, from m coarser unknowns to the n finer unknowns; coarser operators are P' A P + ``added``.
    strip : (k,) int64
        The finer level's unknowns near conditions, which a smoother solves for exactly.
    added : csr_array (m, m), optional
        A further part of the coarser operator, such as the upwinding that its spacing needs.
    lines : (r, k) int64, optional
        Lines of coarser unknowns whose differences of order k - 1 are stabilised: splines that hardly touch the
        manifold have entries so small that rounding determines their sign.
    """

    prolongation: csr_array
    strip: Ints
    added: csr_array | None = None
    lines: Ints | None = None


@dataclass(frozen=True, eq=False)
class SmoothedLevel:
    """The smoother of a level, with its matrix, and the prolongation from the next coarser level.

    Entries are in float32, except on a large finest level and where the diagonal's entries differ too much. That
    changes the cycle by about 1e-7, and not the solution, whose equations are in float64.
    """

    smoother: Smoother
    prolongation: UnsignedCsr


@dataclass(frozen=True, eq=False)
class Cycle:
    """A symmetric V cycle.

    Attributes
    ----------
    levels : tuple of SmoothedLevel
        All levels but the coarsest, from the finest on; none where the matrix is small.
    coarsest : SymmetricFactors
        Factors of the coarsest matrix.
    is_rounded : bool
        Whether entries are in float32.
    """

    levels: tuple[SmoothedLevel, ...]
    coarsest: SymmetricFactors
    is_rounded: bool = True

    @property
    def products(self) -> int:
        """The number of products with the finest matrix in one cycle."""
        return self.levels[0].smoother.iteration.products if self.levels else 0

    def apply(self, b: Floats, depth: int = 0) -> Floats:
        """Return an approximate solution x (n, channels) of ``A x = b`` on level ``depth``."""
        if depth == len(self.levels):
            return self.coarsest.solve(b)
        level = self.levels[depth]
        x, residual = level.smoother.before(b)
        level.prolongation.add_product(x, self.apply(level.prolongation.apply_transposed(residual), depth + 1))
        return level.smoother.after(x, b)


def build_cycle(
    matrix: csr_array,
    levels: Sequence[Level],
    piece: Ints,
    waves: bool = False,
    half: SymmetricCsr | None = None,
    is_rounded: bool = True,
) -> Cycle:
    """Return the V cycle of a symmetric matrix.

    Parameters
    ----------
    matrix : csr_array (n, n)
        A, positive definite, except for constants on free pieces and for ``waves``.
    levels : sequence of Level
        The steps to coarser levels, from the finest on.
    piece : (n,) int64
        For each unknown, the number of the piece of the manifold with a free constant that it is on, -1 for none.
    waves : bool
        Whether A has negative eigenvalues, with eigenfunctions that all levels resolve.
    half : SymmetricCsr, optional
        The upper half of ``matrix``, if it exists already.
    is_rounded : bool
        Whether entries are rounded to float32 where the diagonal allows it.

    Raises
    ------
    IndefiniteError
        If an eigenvalue has the wrong sign.
    """
    is_rounded = is_rounded and not needs_float64(matrix.diagonal())
    halves, strips = [as_symmetric_csr(matrix) if half is None else half], []
    for level in levels:  # all coarser matrices first: temporary tables are not in memory together with smoothers
        P, current = level.prolongation, halves[-1]
        strip = _without_singular(level.strip, piece)
        strips.append(_exact_strip(matrix if len(halves) == 1 else current, strip, waves, is_rounded))
        coarser = coarse_operator(matrix, P) if current is None else current.galerkin_product(P)
        halves.append(coarser if level.lines is None else stabilise_lines(coarser, level.lines))
        if len(halves) == 2:  # takes time, which only the largest level is worth
            release_memory()
        coarse_piece = np.full(P.shape[1], -1)
        coarse_piece[P.indices] = np.repeat(piece, np.diff(P.indptr))
        piece = coarse_piece
    last = halves.pop()
    coarsest = matrix if last is None or not levels else last.full().to_csr()
    kind = SymmetricFactors if waves else PositiveFactors
    factors = kind.of(_pin_constants(coarsest, piece), "on the coarsest level")
    smoothed = []
    for level in reversed(levels):  # the finest, which is the largest, when all others are rounded
        current = halves.pop()
        diagonal = matrix.diagonal() if current is None else current.diagonal
        if current is None:
            rows: SymmetricCsr | UnsignedCsr = in_float32(matrix, MAX_ROUNDED_ENTRIES if is_rounded else 0)
        else:
            rows = current.in_float32() if is_rounded else current
        del current
        if len(halves) == 1:
            release_memory()
        rows = rows.for_threads() if isinstance(rows, SymmetricCsr) else rows
        smoother = _smoother(diagonal, rows, strips.pop(), waves, COARSER_SWEEPS if halves else FINEST_SWEEPS)
        prolongation = UnsignedCsr.of(level.prolongation)
        smoothed.append(SmoothedLevel(smoother, prolongation.in_float32() if is_rounded else prolongation))
    return Cycle(tuple(reversed(smoothed)), factors, is_rounded)


def needs_float64(diagonal: Floats) -> bool:
    """Return whether float32 would lose the stiffness of unknowns with small entries of the ``diagonal`` (n,)."""
    positive = diagonal[diagonal > ZERO_DIAGONAL_SHARE * diagonal.max(initial=0.0)]
    return len(positive) > 0 and bool(positive.max() > MAX_DIAGONAL_RATIO * positive.min())


def stabilise_lines(half: SymmetricCsr, lines: Ints) -> SymmetricCsr:
    """Return the matrix plus a penalty on the differences of order k - 1 of the unknowns of ``lines`` (r, k)."""
    from scipy.sparse import csr_array

    r, k = lines.shape
    scale = LINE_STABILISATION * half.diagonal[lines].max(axis=1)
    stencil = np.array([(-1.0) ** place * comb(k - 1, place) for place in range(k)])
    entries = np.sqrt(scale)[:, None] * stencil
    rows = csr_array((entries.ravel(), lines.ravel(), np.arange(0, r * k + 1, k)), shape=(r, len(half)))
    return SymmetricCsr.of((half.full().to_csr() + rows.T @ rows).tocsr())


def _exact_strip(matrix: csr_array | SymmetricCsr, unknowns: Ints, waves: bool, is_rounded: bool) -> Strip | None:
    """Return the strip of ``unknowns`` (k,), for which the smoother solves exactly; None if there are none."""
    if not len(unknowns):
        return None
    if isinstance(matrix, SymmetricCsr):
        return Strip.of(matrix.rows_of(unknowns), unknowns, waves, is_rounded)
    return Strip.of(matrix[unknowns].tocsr(), unknowns, waves, is_rounded and matrix.nnz <= MAX_ROUNDED_ENTRIES)


def _smoother(
    diagonal: Floats, rows: UnsignedCsr | SymmetricCsr, exact: Strip | None, waves: bool, sweeps: int
) -> Smoother:
    """Return the smoother of a level: Gauss-Seidel for matrices stored as upper halves, else Chebyshev, after a strip.

    Raises
    ------
    IndefiniteError
        If an entry of the diagonal or an eigenvalue has the wrong sign.
    """
    swept = abs(diagonal) > ZERO_DIAGONAL_SHARE * diagonal.max()
    if exact is not None:
        swept[exact.unknowns] = False
    if (diagonal[swept] < 0).any():
        raise IndefiniteError("it has entries below zero on the diagonal")
    inverse = np.zeros(len(diagonal))
    inverse[swept] = 1 / diagonal[swept]
    if isinstance(rows, SymmetricCsr) and not waves:
        return Smoother(GaussSeidel(rows, inverse, sweeps), exact)
    largest = EIGENVALUE_MARGIN * largest_eigenvalue(rows, inverse, waves)
    return Smoother(Chebyshev(rows, inverse, largest, 3), exact)


def _without_singular(strip: Ints, piece: Ints) -> Ints:
    """Return the strip without one unknown of each free piece that is entirely in it, where A would be singular."""
    count = piece.max(initial=-1) + 1
    inside = np.bincount(piece[strip] + 1, minlength=count + 1) == np.bincount(piece + 1, minlength=count + 1)
    inside[0] = False
    labels, first = np.unique(piece[strip], return_index=True)
    return np.delete(strip, first[inside[labels + 1]])


def _pin_constants(matrix: csr_array, piece: Ints) -> csr_array:
    """Return the matrix with the diagonal increased at one unknown of each free piece, which fixes its constant."""
    from scipy.sparse import dia_array

    labels, first = np.unique(piece, return_index=True)
    added = np.zeros(len(piece))
    added[first[labels >= 0]] = matrix.diagonal().max() or 1.0
    return (matrix + dia_array((added[None, :], [0]), shape=matrix.shape)).tocsr()


#: Relative residual of the eigenvector at which Lanczos' method stops: the eigenvalue is then right to 1e-2 or 3e-2.
LANCZOS_RESIDUAL = 3e-2


def largest_eigenvalue(matrix: UnsignedCsr | SymmetricCsr, inverse: Floats, waves: bool = False) -> float:
    """Return the largest eigenvalue of ``D^-1 A`` by Lanczos' method, a lower bound within about a hundredth.

    A is restricted to the unknowns where ``inverse`` (n,), the diagonal of D^-1, is not zero. 8 to 12 products are
    usual.

    Raises
    ------
    IndefiniteError
        If there is a negative eigenvalue, and no ``waves`` are expected.
    """
    root = np.sqrt(inverse)[:, None]
    v = np.random.default_rng(0).standard_normal(root.shape) * (root > 0)
    before, beta = np.zeros_like(v), _dot(v, v) ** 0.5
    diagonal: list[float] = []
    off_diagonal: list[float] = []
    while beta > 0 and len(diagonal) < 50:
        v *= 1 / beta
        before *= -beta
        w = matrix.apply(root * v)
        w *= root
        w += before
        diagonal.append(_dot(v, w))
        w -= diagonal[-1] * v
        before, v, beta = v, w, _dot(w, w) ** 0.5
        values, vectors = np.linalg.eigh(np.diag(diagonal) + np.diag(off_diagonal, 1) + np.diag(off_diagonal, -1))
        off_diagonal.append(beta)
        if beta * abs(vectors[-1, -1]) <= LANCZOS_RESIDUAL * values[-1]:
            break
    if diagonal and not waves and not values[0] > -LANCZOS_RESIDUAL * abs(values[-1]):
        raise IndefiniteError("it has eigenvalues of the wrong sign")
    return float(values[-1]) if diagonal else 1.0


def _dot(a: Floats, b: Floats) -> float:
    """Return the scalar product of a and b (n, channels)."""
    return float(np.einsum("nc,nc->", a, b))  # BLAS would wake other threads, which then wait for work
