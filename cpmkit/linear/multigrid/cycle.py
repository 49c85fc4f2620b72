"""A symmetric V cycle over a form's levels, with coarser operators P' A P."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import comb
from typing import TYPE_CHECKING

import numpy as np

from cpmkit.linear.csr_matrices import SymmetricCsr, UnsignedCsr, coarse_operator, halved, rounded
from cpmkit.linear.direct import Indefinite, PositiveFactors, SymmetricFactors
from cpmkit.linear.multigrid.smoothers import COARSER_SWEEPS, FINEST_SWEEPS, Chebyshev, GaussSeidel, Smoother, Strip
from cpmkit.protocols import Floats, Ints
from cpmkit.runtime.memory import hand_back

if TYPE_CHECKING:
    from scipy.sparse import csr_array


@dataclass(frozen=True, eq=False)
class Level:
    """One step from a finer level to the next coarser one; a form hands them out from the finest on.

    Attributes
    ----------
    prolongation : csr_array (n, m)
        P, from m coarser unknowns to the n finer ones; coarser operators are P' A P, and what is ``added``.
    strip : (k,) int64
        Those of the finer level's unknowns that conditions tie, which a smoother solves for exactly.
    added : csr_array (m, m), optional
        What the coarser operator has besides, as a velocity needs more upwinding there.
    lines : (r, k) int64, optional
        Coarser unknowns in a row, whose differences of order k - 1 are held a little: what hardly touches the manifold
        has entries so small elsewhere that rounding makes their sign.
    """

    prolongation: csr_array
    strip: Ints
    added: csr_array | None = None
    lines: Ints | None = None


#: Products with A of each smoothing, before and after the coarser level.
SMOOTHING_STEPS = 3
#: What the eigenvalue that Lanczos' method finds, from below, is multiplied by.
EIGENVALUE_MARGIN = 1.1
#: A finest matrix with more entries is smoothed as it is: rounded ones beside it would be an eighth of the memory at
#: the peak, and save a tenth of the time of a solve.
MOST_ROUNDED = 1 << 25
#: A diagonal entry below this share of the largest is zero: of a piece with one unknown on which a constant is free.
ROUNDING = 1e-14
#: Where entries of the finest diagonal differ by more, those of 32 bits make a cycle indefinite: penalties on slivers
#: between close curves round away the stiffness beside them.
MOST_DIAGONAL_RATIO = 1e6
#: By this share of the largest diagonal entry on it a line's differences are held: above what entries of 32 bits lose.
HELD_SHARE = 1e-6


@dataclass(frozen=True, eq=False)
class Stage:
    """One level that is smoothed: its smoother, with its matrix, and P from the next coarser one.

    Entries have 32 bits, but of a large finest level, and where a diagonal's entries differ too much. That changes the
    cycle by 1e-7 or so and the solution by nothing: its equations keep 64.
    """

    smoother: Smoother
    prolongation: UnsignedCsr


@dataclass(frozen=True, eq=False)
class Cycle:
    """A symmetric V cycle.

    Attributes
    ----------
    stages : tuple of Stage
        From the finest on; none where the matrix is small.
    coarsest : SymmetricFactors
        Of the last level's matrix.
    is_rounded : bool
        Whether entries have 32 bits.
    """

    stages: tuple[Stage, ...]
    coarsest: SymmetricFactors
    is_rounded: bool = True

    @property
    def products(self) -> int:
        """How many products with the finest matrix it takes."""
        return self.stages[0].smoother.iteration.products if self.stages else 0

    def apply(self, b: Floats, depth: int = 0) -> Floats:
        """Return x (n, channels), about the solution of ``A x = b`` on the level at ``depth``."""
        if depth == len(self.stages):
            return self.coarsest.solve(b)
        stage = self.stages[depth]
        x, residual = stage.smoother.before(b)
        stage.prolongation.add_to(x, self.apply(stage.prolongation.transposed(residual), depth + 1))
        return stage.smoother.after(x, b)


def cycle_of(
    matrix: csr_array,
    levels: Sequence[Level],
    piece: Ints,
    waves: bool = False,
    half: SymmetricCsr | None = None,
    is_rounded: bool = True,
) -> Cycle:
    """Return the cycle of a symmetric matrix.

    Parameters
    ----------
    matrix : csr_array (n, n)
        A, positive definite but for constants on free pieces, and for ``waves``.
    levels : sequence of Level
        From the finest on.
    piece : (n,) int64
        The free piece that an unknown is on, -1 for none.
    waves : bool
        Whether eigenvalues below zero are expected, whose functions all levels resolve.
    half : SymmetricCsr, optional
        The same matrix, where it is held so already.
    is_rounded : bool
        Whether entries have 32 bits where its diagonal lets them.

    Raises
    ------
    Indefinite
        If an eigenvalue of the wrong sign shows.
    """
    is_rounded = is_rounded and not loses_by_rounding(matrix.diagonal())
    halves, strips = [halved(matrix) if half is None else half], []
    for level in levels:  # what this needs on the way is not in memory together with what follows
        P, own = level.prolongation, halves[-1]
        strips.append(_strip(matrix if len(halves) == 1 else own, _open(level.strip, piece), waves, is_rounded))
        coarser = coarse_operator(matrix, P) if own is None else own.coarser(P)
        halves.append(coarser if level.lines is None else with_lines_held(coarser, level.lines))
        if len(halves) == 2:  # what is handed back must be cleared anew: of the others it is little
            hand_back()
        coarse = np.full(P.shape[1], -1)
        coarse[P.indices] = np.repeat(piece, np.diff(P.indptr))
        piece = coarse
    last = halves.pop()
    coarsest = matrix if last is None or not levels else last.whole().to_csr()
    factors = (SymmetricFactors if waves else PositiveFactors).of(_held(coarsest, piece), "on the coarsest level")
    stages = []
    for level in reversed(levels):  # the finest, which is the largest, when entries of 64 bits of all others are gone
        own = halves.pop()
        diagonal = matrix.diagonal() if own is None else own.diagonal
        if own is None:
            rows: SymmetricCsr | UnsignedCsr = rounded(matrix, MOST_ROUNDED if is_rounded else 0)
        else:
            rows = own.rounded() if is_rounded else own
        del own
        if len(halves) == 1:
            hand_back()
        rows = rows.shared() if isinstance(rows, SymmetricCsr) else rows
        sweeps = COARSER_SWEEPS if halves else FINEST_SWEEPS
        smoother = _smoother(diagonal, rows, strips.pop(), waves, sweeps)
        prolongation = UnsignedCsr.of(level.prolongation)
        stages.append(Stage(smoother, prolongation.rounded() if is_rounded else prolongation))
    return Cycle(tuple(reversed(stages)), factors, is_rounded)


def loses_by_rounding(diagonal: Floats) -> bool:
    """Tell whether entries of 32 bits lose what the smallest entries of a diagonal (n,) stand for."""
    positive = diagonal[diagonal > ROUNDING * diagonal.max(initial=0.0)]
    return len(positive) > 0 and bool(positive.max() > MOST_DIAGONAL_RATIO * positive.min())


def with_lines_held(half: SymmetricCsr, lines: Ints) -> SymmetricCsr:
    """Return the matrix with the differences of unknowns on ``lines`` (r, k) held, by a small share of its diagonal."""
    from scipy.sparse import csr_array

    r, k = lines.shape
    scale = HELD_SHARE * half.diagonal[lines].max(axis=1)
    stencil = np.array([(-1.0) ** place * comb(k - 1, place) for place in range(k)])
    entries = np.sqrt(scale)[:, None] * stencil
    rows = csr_array((entries.ravel(), lines.ravel(), np.arange(0, r * k + 1, k)), shape=(r, len(half)))
    return SymmetricCsr.of((half.whole().to_csr() + rows.T @ rows).tocsr())


def _strip(matrix: csr_array | SymmetricCsr, unknowns: Ints, waves: bool, is_rounded: bool) -> Strip | None:
    if not len(unknowns):
        return None
    if isinstance(matrix, SymmetricCsr):
        return Strip.of(matrix.rows_of(unknowns), unknowns, waves, is_rounded)
    return Strip.of(matrix[unknowns].tocsr(), unknowns, waves, is_rounded and matrix.nnz <= MOST_ROUNDED)


def _smoother(
    diagonal: Floats, rows: UnsignedCsr | SymmetricCsr, exact: Strip | None, waves: bool, sweeps: int
) -> Smoother:
    swept = abs(diagonal) > ROUNDING * diagonal.max()
    if exact is not None:
        swept[exact.unknowns] = False
    if (diagonal[swept] < 0).any():
        raise Indefinite("it has entries below zero on the diagonal")
    inverse = np.zeros(len(diagonal))
    inverse[swept] = 1 / diagonal[swept]
    if isinstance(rows, SymmetricCsr) and not waves:
        return Smoother(GaussSeidel(rows, inverse, sweeps), exact)
    largest = EIGENVALUE_MARGIN * largest_eigenvalue(rows, inverse, waves)
    return Smoother(Chebyshev(rows, inverse, largest, SMOOTHING_STEPS), exact)


def _open(strip: Ints, piece: Ints) -> Ints:
    """Return the strip without one unknown of each free piece that lies in it whole, on which A is singular."""
    count = piece.max(initial=-1) + 1
    inside = np.bincount(piece[strip] + 1, minlength=count + 1) == np.bincount(piece + 1, minlength=count + 1)
    inside[0] = False
    labels, first = np.unique(piece[strip], return_index=True)
    return np.delete(strip, first[inside[labels + 1]])


def _held(matrix: csr_array, piece: Ints) -> csr_array:
    """Return the matrix with one unknown of each free piece held, which fixes the constants there."""
    from scipy.sparse import dia_array

    labels, first = np.unique(piece, return_index=True)
    held = np.zeros(len(piece))
    held[first[labels >= 0]] = matrix.diagonal().max() or 1.0
    return (matrix + dia_array((held[None, :], [0]), shape=matrix.shape)).tocsr()


#: Relative residual of the eigenvector at which the iteration stops: the eigenvalue is then right to 1e-2, measured on
#: matrices with conditions and without, three hundredths at most.
LANCZOS_RESIDUAL = 3e-2
#: Products with A at most; 8 to 12 are usual.
LANCZOS_STEPS = 50


def largest_eigenvalue(matrix: UnsignedCsr | SymmetricCsr, inverse: Floats, waves: bool = False) -> float:
    """Return the largest eigenvalue of ``D^-1 A`` on the unknowns where ``inverse`` (n,), which is D^-1, is not zero.

    It is met from below, to about a hundredth.

    Raises
    ------
    Indefinite
        If an eigenvalue below zero shows, and there are to be no ``waves``.
    """
    root = np.sqrt(inverse)[:, None]
    v = np.random.default_rng(0).standard_normal(root.shape) * (root > 0)
    before, beta = np.zeros_like(v), _dot(v, v) ** 0.5
    diagonal: list[float] = []
    beside: list[float] = []
    while beta > 0 and len(diagonal) < LANCZOS_STEPS:
        v *= 1 / beta
        before *= -beta
        w = matrix.apply(root * v)
        w *= root
        w += before  # zero at first
        diagonal.append(_dot(v, w))
        w -= diagonal[-1] * v
        before, v, beta = v, w, _dot(w, w) ** 0.5
        values, vectors = np.linalg.eigh(np.diag(diagonal) + np.diag(beside, 1) + np.diag(beside, -1))
        beside.append(beta)
        if beta * abs(vectors[-1, -1]) <= LANCZOS_RESIDUAL * values[-1]:
            break
    if diagonal and not waves and not values[0] > -LANCZOS_RESIDUAL * abs(values[-1]):
        raise Indefinite("it has eigenvalues of the wrong sign")
    return float(values[-1]) if diagonal else 1.0


def _dot(a: Floats, b: Floats) -> float:
    return float(np.einsum("nc,nc->", a, b))  # on this thread; BLAS would wake others, which then wait for more
