"""The diffusivity at samples of the manifold: numbers or tensors, positive on tangents."""

from __future__ import annotations

import numpy as np

from cpmkit.errors import InputError, place
from cpmkit.protocols import Floats
from cpmkit.scene.diffusivities import principal_values

#: A tensor whose smallest eigenvalue on tangents is below this share of its largest is not told from a singular one.
SINGULAR_SHARE = 1e-12


def checked_number(a: Floats) -> Floats:
    """Return a diffusivity (k,) if it is positive.

    Raises
    ------
    InputError
        With the smallest value.
    """
    if np.any(a <= 0):
        raise InputError(f"the diffusivity must be above zero, got {a.min():g}.")
    return a


def checked(a: Floats, normals: Floats, points: Floats) -> Floats:
    """Return a diffusivity (k, d, d) if it is positive on tangents at all ``points`` (k, d).

    Parameters
    ----------
    a : (k, d, d) float64
        At the samples.
    normals : (k, c, d) float64
        Orthonormal vectors normal to the manifold.
    points : (k, d) float64
        In the scene's coordinates.

    Raises
    ------
    InputError
        With the place and the smallest eigenvalue.
    """
    least, largest = principal_values(a, normals)
    worst = int(np.argmin(least - SINGULAR_SHARE * largest))
    if least[worst] <= SINGULAR_SHARE * largest[worst]:
        raise InputError(
            f"the diffusivity must be positive definite on tangents of the manifold, got a tensor near "
            f"{place(points[worst])} whose smallest eigenvalue there is {least[worst]:.3g}, and the largest "
            f"{largest[worst]:.3g}."
        )
    return a
