"""A diffusivity that depends on the solution, at one state: what families of equations hand to a form."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from cpmkit.protocols import Floats


@dataclass(frozen=True, eq=False)
class AtState:
    """A coefficient where u is known: forms read u and its slope at the places where they want it.

    Attributes
    ----------
    coefficient : callable
        Of the values (k,) of u, its tangential gradients (k, d) and the points (k, d), in the scene's coordinates:
        returns numbers (k,) or symmetric tensors (k, d, d).
    u : (n, 1) float64
        The unknowns.
    """

    coefficient: Callable[[Floats, Floats, Floats], Floats]
    u: Floats
