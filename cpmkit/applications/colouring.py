"""Diffusion curves: colours held on both sides of curves, and as smooth as they can be between them.

Each of the three channels solves the Laplace equation between the curves: in the plane Orzan et al. (2008), on
manifolds King et al. (2024), section 7.1. By the maximum principle no colour between them is brighter or darker than
those held on the sides that it sees.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

import cpmkit as ck
from cpmkit.applications.curve_colours import Along, colour_data
from cpmkit.applications.held import held_ends
from cpmkit.applications.painted import painted
from cpmkit.applications.result import Result
from cpmkit.errors import InputError, SceneError, shown
from cpmkit.facade import Solution
from cpmkit.protocols import ClosestPointSource, Floats

#: Sides of a curve.
SIDES = {"left", "right"}


@dataclass(frozen=True, eq=False, repr=False)
class ColouredSurface(Result):
    """Colours everywhere on a manifold: read, saved and drawn as a solution of three channels.

    Attributes
    ----------
    solution : Solution
        Red, green and blue, as they were solved for: at the tips and crossings of curves by some hundredths beyond the
        colours that are held.
    ends : (2, 3) float64
        The least and the largest red, green and blue that are held: no colour is beyond, so that what was solved for is
        cut off there.
    """

    ends: Floats

    def evaluate(self, points: Any, side: Any = None) -> Floats:
        """Return the colours (n, 3), from 0 to 1, at the points of the manifold nearest to ``points`` (n, d).

        ``side`` says from where points on a curve are read, as for :meth:`cpmkit.Solution.evaluate`.
        """
        return self.limited(self.solution.evaluate(points, side))

    def limited(self, colours: Floats) -> Floats:
        """Return colours (n, 3) between those that are held."""
        return np.asarray(np.clip(colours, *self.ends))

    def drawn(self) -> Solution:
        """Return the solution with its display mesh in these colours."""
        return painted(self.solution, self.limited(self.solution.display_mesh().values))


def diffusion_curves(
    surface: ClosestPointSource | ck.Scene,
    curves: Sequence[tuple[ClosestPointSource, Any]] | Mapping[str, tuple[ClosestPointSource, Any]],
    *,
    spacing: float | None = None,
    **options: Any,
) -> ColouredSurface:
    """Return the colours that curves with a colour on each side spread over a curve, surface or solid.

    Parameters
    ----------
    surface : ClosestPointSource or Scene
        The manifold; a scene, whose boundaries and edge hold besides: each has one channel, or three.
    curves : sequence or mapping of pairs
        Each a curve and its colours, those of both sides, or ``{"left": ..., "right": ...}``. A side has a colour (a
        name of CSS, ``"#rrggbb"``, three numbers from 0 to 1); colours along the curve, linear in its arc length:
        (k, 3) from its start to its end, or (k, 4) with the share of the length first, or a list of names, or the name
        of a ``.npy`` or ``.csv`` file of such rows; a function of points (n, d) that returns (n, 3); or None, where
        nothing passes. In a mapping the keys are the curves' names.
    spacing : float
        Of the lattice, in the scene's unit; or ``tolerance`` or ``seconds`` in its place.
    **options
        Of :func:`cpmkit.solve`.

    Returns
    -------
    ColouredSurface

    Raises
    ------
    InputError, SceneError
        If an argument is not what is accepted, or a piece of the manifold sees no colour.

    Examples
    --------
    The equator of a sphere is white to the north and, to the south, green and blue in turn.

    >>> import cpmkit as ck
    >>> from cpmkit.applications import diffusion_curves
    >>> equator = ck.source("analytic.circle", normal=[0, 0, 1])
    >>> colours = {"left": "white", "right": ["lime", "blue", "lime"]}
    >>> found = diffusion_curves(ck.source("analytic.sphere"), [(equator, colours)], spacing=0.2)
    >>> (found.evaluate([[0, 0, 1], [0, 0, -1]]) + 1e-6).round(2).tolist()
    [[1.0, 1.0, 1.0], [0.0, 0.5, 0.5]]
    """
    scene = surface if isinstance(surface, ck.Scene) else ck.Scene(surface, ck.Laplace())
    named = curves if isinstance(curves, Mapping) else {f"curve {number}": one for number, one in enumerate(curves)}
    boundaries = [_boundary(name, pair) for name, pair in named.items()]
    held = any(one.condition(side).kind == "dirichlet" for one in boundaries for side in ("left", "right"))
    if not held:
        raise InputError("no side of a curve holds a colour; give one at least.")
    whole = ck.Scene(scene.surface, ck.Laplace(), [*scene.boundaries, *boundaries], scene.edge)
    solution = ck.solve(whole, spacing, **options)
    _check_every_piece_coloured(solution)
    return ColouredSurface(solution, held_ends(whole, 0.25 * solution.spacing))


def _check_every_piece_coloured(solution: Solution) -> None:
    """Refuse a solution with pieces on which a colour is free, because they see no side that holds one."""
    free = [one for one in solution.imbalances if one.of == "data"]
    if free:
        where, share = ", ".join(f"{x:.3g}" for x in free[0].near), 100 * free[0].share
        raise SceneError(
            f"a piece of the manifold about ({where}), {share:.0f} percent of it, sees no side of a curve "
            "that holds a colour; give it one."
        )


def _boundary(name: str, pair: Any) -> ck.Boundary:
    if not isinstance(pair, (tuple, list)) or len(pair) != 2 or not isinstance(pair[0], ClosestPointSource):
        raise InputError(f"{name} must be a pair (source of a curve, its colours), got {shown(pair)}.")
    curve, colours = pair
    along = Along(curve)
    if not isinstance(colours, Mapping):
        return ck.Boundary(name, curve, both=_condition(colours, along, f"the colour of {name}"))
    if set(colours) != SIDES:
        raise InputError(
            f"colours of {name} are given as left and right, with None where nothing passes, got "
            f"{', '.join(map(str, colours)) or 'none'}."
        )
    sides = {side: _condition(colours[side], along, f"the {side} colour of {name}") for side in ("left", "right")}
    return ck.Boundary(name, curve, **sides)


def _condition(given: Any, along: Along, what: str) -> Any:
    return ck.Neumann(0.0) if given is None else ck.Dirichlet(colour_data(given, along, what))
