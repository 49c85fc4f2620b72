"""What a velocity carries in through boundaries where u itself is given, or goes on from the other side.

Where v . b < 0, b the conormal out of a side, ``|v . b| (u - g) phi`` is added on that side, g the value given or the
value across (less the jump): upwinding, as of discontinuous elements. Where v leaves nothing is added, and a layer
that the spacing does not resolve is left out rather than followed by oscillations.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cpmkit.forms.galerkin.conditions.one_side import scaled
from cpmkit.protocols import Floats

if TYPE_CHECKING:
    from scipy.sparse import csr_array


def entering(out: Floats, weights: Floats, values: csr_array) -> tuple[csr_array, csr_array]:
    """Return what is added to the matrix (n, n), and by which matrix (n, k) the values given (k,) add to b.

    Parameters
    ----------
    out : (k,) float64
        v . b.
    weights : (k,) float64
        The samples' weights.
    values : csr_array (k, n)
        Rows that read u.
    """
    tested = scaled(weights * np.maximum(-out, 0.0), values).T.tocsr()
    return (tested @ values).tocsr(), tested


def going_on(
    out: tuple[Floats, Floats], weights: Floats, first: csr_array, second: csr_array
) -> tuple[csr_array, csr_array]:
    """Return the same of two sides whose u differ by the jump (k,), the first less the second.

    Parameters
    ----------
    out : two (k,) float64
        v . b out of each side.
    weights : (k,) float64
        The samples' weights.
    first, second : csr_array (k, n)
        Rows that read u on each side.
    """
    tested = scaled(weights * np.maximum(-out[0], 0.0), first) - scaled(weights * np.maximum(-out[1], 0.0), second)
    tested = tested.T.tocsr()
    return (tested @ (first - second)).tocsr(), tested
