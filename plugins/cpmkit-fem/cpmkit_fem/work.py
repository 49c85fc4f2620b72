"""What a solve by finite elements cost, in units that no machine changes."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True)
class FemWork:
    """Machine-independent measures of a solve.

    Attributes
    ----------
    unknowns : int
        Vertices that nothing pins.
    vertices, faces : int
        Of the triangulation.
    nonzeros : int
        Stored entries of the matrix.
    operator_applications : int
        Products with it.
    """

    unknowns: int
    vertices: int
    faces: int
    nonzeros: int
    operator_applications: int

    def as_dict(self) -> dict[str, Any]:
        """Return the measures by name."""
        return asdict(self)
