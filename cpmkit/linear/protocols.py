"""The interfaces (protocols) of operators and linear solvers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Protocol

from cpmkit.types import Floats, Ints, Progress, SparseMatrix, no_progress

if TYPE_CHECKING:
    from cpmkit.linear.residuals import SolveReport


class Operator(Protocol):
    """A square linear map of n unknowns, in any storage, with all that solvers need."""

    @property
    def size(self) -> int:
        """The number n of unknowns."""

    @property
    def nonzeros(self) -> int:
        """The number of stored entries."""

    @property
    def symmetric(self) -> bool:
        """Whether the operator is known to be symmetric."""

    @property
    def diagonal(self) -> float | Floats:
        """The diagonal, a number if it is constant, else (n, 1)."""

    def apply(self, u: Floats, /) -> Floats:
        """Return A u for u (n,) or (n, channels)."""

    def apply_rows(self, u: Floats, rows: Ints, /) -> Floats:
        """Return the entries ``rows`` (r,) of A u, (r,) or (r, channels)."""

    def to_csr(self) -> SparseMatrix:
        """Return the operator as one sparse matrix (n, n)."""

    def pieces(self) -> tuple[int, Ints]:
        """Return the number of sets of unknowns that the operator does not couple, and the set (n,) of each unknown."""


class Stiffness(Operator, Protocol):
    """The operator A of an equation's terms in a form, to which time steps and eigenvalue iterations add a mass."""

    def scaled_plus_mass(self, factor: float, mass: Any = None, /) -> Operator:
        """Return the operator ``M + factor A``; M is the form's mass matrix, None for the identity."""

    def minus_shifted_mass(self, shift: float, mass: Any = None, /) -> Operator:
        """Return the operator ``A - shift M``; M is the eigenvalue problem's mass matrix, None for the identity."""


class PreparedSolver(Protocol):
    """A solver that has factorised one operator, or built its coarser levels."""

    def solve(
        self, b: Floats, tolerance: float, guess: Floats | None = None, progress: Progress = no_progress
    ) -> tuple[Floats, SolveReport]:
        """Return u (n, channels) with A u = b, and a report; iterations start from ``guess``, zero if None.

        Raises ConvergenceError if the relative residual, recomputed, is above ``tolerance`` and what rounding leaves.
        """


class LinearSolver(Protocol):
    """A linear solver in two phases, preparation and solves; a plugin's factory in ``cpmkit_solvers`` returns one.

    The prepared solver is reused for all channels, time steps, Newton steps and eigenvalue iterations. A solver whose
    attribute ``takes_levels`` is false gets no levels, and the form builds none.
    """

    def prepare(self, operator: Operator, levels: Sequence[Any] = ()) -> PreparedSolver:
        """Return the prepared solver for ``operator``; ``levels`` are the form's coarser levels, if it has any."""
