"""What a solve in the Galerkin form took, in units that no machine enters."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True)
class GalerkinWork:
    """Machine-independent measures of a solve.

    Attributes
    ----------
    unknowns, samples, patches : int
        Of the space of splines.
    closest_point_queries : int
        Of the manifold and its boundaries.
    nonzeros : int
        Stored entries of the matrix.
    operator_applications : int
        Products with it.
    """

    unknowns: int
    samples: int
    patches: int
    closest_point_queries: int
    nonzeros: int
    operator_applications: int

    def as_dict(self) -> dict[str, Any]:
        """Return the measures as plain values."""
        return asdict(self)
