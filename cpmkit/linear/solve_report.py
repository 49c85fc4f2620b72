"""The report of a linear solve."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True)
class SolveReport:
    """The outcome of a linear solve.

    Attributes
    ----------
    solver : str
        Name of the solver.
    converged : bool
        True if ``residual <= tolerance``, or if rounding forbids a smaller residual, as ``reason`` then states.
    iterations : int
        Largest number of iterations of a channel; 0 for a direct solver.
    operator_applications : int
        Number of products with A, of all channels together.
    residual : float
        The largest ``|b - A u| / |b|`` of a channel, in the Euclidean norm, recomputed from u; A includes its border,
        if it has one. Where most of b is the image of a constant u, the denominator is the norm of the rest.
    tolerance : float
        The relative residual that was requested.
    reason : str
        The residual, the iterations and the tolerance in words.
    """

    solver: str
    converged: bool
    iterations: int
    operator_applications: int
    residual: float
    tolerance: float
    reason: str

    def as_dict(self) -> dict[str, Any]:
        """Return the report as a dictionary of plain values."""
        return asdict(self)
