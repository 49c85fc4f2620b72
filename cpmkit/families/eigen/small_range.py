"""All eigenpairs where there are few: B sees few unknowns, as at the ends of a curve with conditions of Steklov.

Iterations need room: Lanczos' asks for more vectors than such a B has directions. With S the unknowns that B sees and
``G = S' (A - sigma B)^-1 S``, the eigenvalues of the small ``R' G R``, ``R R' = S' B S``, are ``1 / (lambda - sigma)``.
"""

from __future__ import annotations

import numpy as np

from cpmkit.errors import InputError
from cpmkit.families.eigen.inverse_iteration import InverseIteration, Pairs
from cpmkit.types import Ints

#: Unknowns that are few.
MOST_SEEN = 64
#: What is smaller than this share of the largest is rounding.
ROUNDING_SHARE = 1e-9


def few_seen(stepped: InverseIteration) -> Ints | None:
    """Return the unknowns that B sees where they are few, and the problem is symmetric; None elsewhere."""
    if not stepped.symmetric or stepped.mass is None or not hasattr(stepped.mass, "to_csr"):
        return None
    matrix = stepped.mass.to_csr()
    if np.count_nonzero(matrix.data) > MOST_SEEN**2:  # more than so few unknowns have: large ones are not gone through
        return None
    seen = np.unique(matrix.indices[matrix.data != 0])
    return seen if len(seen) <= min(MOST_SEEN, matrix.shape[0] // 2) else None


def all_pairs(stepped: InverseIteration, seen: Ints, count: int) -> Pairs:
    """Return every eigenpair with an eigenvalue that is not infinite.

    Raises
    ------
    InputError
        If there are fewer than ``count``.
    """
    mass, n = stepped.mass.to_csr()[seen][:, seen].toarray(), stepped.operator.size
    sizes, directions = np.linalg.eigh(0.5 * (mass + mass.T))
    kept = sizes > ROUNDING_SHARE * sizes.max(initial=0.0)
    root = directions[:, kept] * np.sqrt(sizes[kept])
    images = np.zeros((n, root.shape[1]))
    images[seen] = root
    inverted = stepped.inverted(images)
    small = root.T @ inverted[seen]
    theta, vectors = np.linalg.eigh(0.5 * (small + small.T))
    finite = np.abs(theta) > ROUNDING_SHARE * np.abs(theta).max()
    if finite.sum() < count:
        raise InputError(
            f"count={count} is more than the {int(finite.sum())} eigenvalues that there are: lambda stands in the "
            "conditions of so few points; ask for these."
        )
    return Pairs(stepped.shift + 1 / theta[finite], inverted @ (vectors[:, finite] / theta[finite]))


def dense_pairs(stepped: InverseIteration, count: int) -> Pairs:
    """Return every eigenpair of a problem with few unknowns, by a dense matrix; those that are infinite are left out.

    Raises
    ------
    InputError
        If there are fewer than ``count``.
    """
    n = stepped.operator.size
    theta, vectors = np.linalg.eig(stepped.step(np.eye(n)))
    finite = np.abs(theta) > ROUNDING_SHARE * np.abs(theta).max()
    if finite.sum() < count:
        raise InputError(
            f"count={count} is more than the {int(finite.sum())} eigenvalues of a mesh or lattice with {n} unknowns; "
            "ask for fewer, or use a finer mesh or a smaller spacing."
        )
    return Pairs(stepped.shift + 1 / theta[finite], vectors[:, finite])
