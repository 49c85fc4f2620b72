"""Types of arrays, of matrices, of sides and of progress callbacks used in the whole package."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from scipy.sparse import csr_array

    SparseMatrix = csr_array
else:  # SciPy is imported by the functions that make matrices
    SparseMatrix = Any
Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
Side = Literal["left", "right"]
#: The side of boundaries from which a solution is evaluated: one for all, or one for each by name.
Sides = Side | Mapping[str, Side] | None
#: A side of boundaries as above, or both sides at once.
ReadSides = Sides | Literal["both"]
#: Both sides of a boundary.
SIDES: tuple[Side, Side] = ("left", "right")

#: Called with the name of a stage and the share of it that is done, from 0 to 1.
Progress = Callable[[str, float], None]


def no_progress(stage: str, fraction: float) -> None:
    """Do nothing: the progress callback that reports neither ``stage`` nor ``fraction``."""
