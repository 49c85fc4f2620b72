"""The contracts of operators and linear solvers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

from cpmkit.types import Floats, Ints, Progress, no_progress

if TYPE_CHECKING:
    from scipy.sparse import csr_array

    from cpmkit.linear.solve_report import SolveReport


class Operator(Protocol):
    """A square linear map of n unknowns, in any storage: all that a solver uses."""

    @property
    def size(self) -> int:
        """Number of unknowns, n."""

    @property
    def nonzeros(self) -> int:
        """Number of stored entries."""

    @property
    def symmetric(self) -> bool:
        """Whether it is known to be symmetric."""

    @property
    def diagonal(self) -> float | Floats:
        """The divisor of Jacobi's preconditioner: a number, or (n, 1)."""

    def apply(self, u: Floats, /) -> Floats:
        """Return the product with u of shape (n,) or (n, channels)."""

    def apply_rows(self, u: Floats, rows: Ints, /) -> Floats:
        """Return the entries ``rows`` of the product."""

    def to_csr(self) -> csr_array:
        """Return it as one sparse matrix (n, n)."""

    def pieces(self) -> tuple[int, Ints]:
        """Return the number of sets of unknowns that are not coupled to each other, and the set of each (n,)."""


class Stiffness(Operator, Protocol):
    """The operator A of an equation's terms in a form; time steps and eigenvalue iterations shift it."""

    def scaled_plus_mass(self, factor: float, mass: Any = None, /) -> Operator:
        """Return ``M + factor A``; M is the form's mass matrix, None for the identity."""

    def minus_shifted_mass(self, shift: float, mass: Any = None, /) -> Operator:
        """Return ``A - shift M``; M is the mass matrix of the eigenvalue problem, None for the identity."""


class PreparedSolver(Protocol):
    """A solver with the factors or coarser levels of one operator."""

    def solve(
        self, b: Floats, tolerance: float, guess: Floats | None = None, progress: Progress = no_progress
    ) -> tuple[Floats, SolveReport]:
        """Return u (n, channels) with A u = b for all channels, and a report; iterations start from ``guess``.

        Raises
        ------
        ConvergenceError
            If the relative residual, recomputed after the solve, is above ``tolerance``.
        """


@runtime_checkable
class Preconditioner(PreparedSolver, Protocol):
    """A prepared solver with a cheap, symmetric, positive definite approximation of the inverse of A."""

    @property
    def step_products(self) -> int:
        """Number of products with A for one application, for each channel."""

    def precondition(self, residual: Floats, /) -> Floats:
        """Return the approximation of A^-1 times ``residual`` (n, channels)."""


class LinearSolver(Protocol):
    """A solver of linear systems in two phases; a plugin's factory in ``cpmkit_solvers`` returns one.

    The prepared solver is reused for all channels, time steps, Newton steps and eigenvalue iterations. A solver whose
    attribute ``takes_levels`` is false gets no levels, and the form builds none.
    """

    def prepare(self, operator: Operator, levels: Sequence[Any] = ()) -> PreparedSolver:
        """Return the solver of systems with ``operator``; ``levels`` are the form's coarser levels, if it has any."""
