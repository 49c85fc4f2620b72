"""Diffusion curves: colours prescribed on both sides of curves and harmonic between them.

Each of the three channels solves the Laplace equation between the curves: in the plane Orzan et al. (2008), on
manifolds King et al. (2024), section 7.1. By the maximum principle no colour between them is brighter or darker than
the prescribed ones.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

import cpmkit as ck
from cpmkit.applications.coloured_meshes import with_colours
from cpmkit.applications.curve_colours import ArcLengthShare, colour_data, prescribed_range
from cpmkit.applications.result import Result
from cpmkit.errors import InputError, SceneError, shown
from cpmkit.facade import Solution
from cpmkit.plugin import ClosestPointSource
from cpmkit.runtime.deprecation import DeprecatedMember
from cpmkit.types import Floats

#: Keys of the colours of a curve.
SIDES = {"left", "right"}


@dataclass(frozen=True, eq=False, repr=False)
class ColouredSurface(Result):
    """Colours everywhere on a manifold: read, saved and drawn as a solution of three channels.

    Attributes
    ----------
    solution : Solution
        Red, green and blue as computed: at tips and crossings of curves some hundredths beyond the prescribed colours.
    ends : (2, 3) float64
        The least and the largest prescribed red, green and blue, between which computed colours are clipped.
    """

    ends: Floats

    def evaluate(self, points: Any, side: Any = None) -> Floats:
        """Return the colours (n, 3), from 0 to 1, at the points of the manifold nearest to ``points`` (n, d).

        ``side`` is the side of points on a curve, as for :meth:`cpmkit.Solution.evaluate`.
        """
        return self.clip(self.solution.evaluate(points, side))

    limited = DeprecatedMember("clip")

    def clip(self, colours: Floats) -> Floats:
        """Return colours (n, 3) clipped to the range of the prescribed colours."""
        return np.asarray(np.clip(colours, *self.ends))

    def drawable(self) -> Solution:
        """Return the solution with the clipped colours as values of its display mesh."""
        return with_colours(self.solution, self.clip(self.solution.display_mesh().values))


def diffusion_curves(
    surface: ClosestPointSource | ck.Scene,
    curves: Sequence[tuple[ClosestPointSource, Any]] | Mapping[str, tuple[ClosestPointSource, Any]],
    *,
    spacing: float | None = None,
    **options: Any,
) -> ColouredSurface:
    """Return the colours that diffuse from curves with a colour on each side over a curve, surface or solid.

    Parameters
    ----------
    surface : ClosestPointSource or Scene
        The manifold; or a scene, whose conditions on boundaries and edge are kept: each has one channel, or three.
    curves : sequence or mapping of pairs
        Each a curve and its colours, of both sides or ``{"left": ..., "right": ...}``. A side has a colour (a
        name of CSS, ``"#rrggbb"``, three numbers from 0 to 1); colours along the curve, linear in its arc length:
        (k, 3) from its start to its end, or (k, 4) with the share of the length first, or a list of names, or the name
        of a ``.npy`` or ``.csv`` file of such rows; a function of points (n, d) that returns (n, 3); or None, for a
        barrier. In a mapping the keys are the curves' names.
    spacing : float
        Spacing of the lattice, in the scene's unit; or ``tolerance`` or ``seconds`` in its place.
    **options
        Options of :func:`cpmkit.solve`.

    Returns
    -------
    ColouredSurface

    Raises
    ------
    InputError, SceneError
        If an argument is not accepted, or a piece of the manifold has no colour on any side of a curve.

    Examples
    --------
    The equator of a sphere is white on its northern side, and green and blue in turn on its southern side.

    >>> import cpmkit as ck
    >>> from cpmkit.applications import diffusion_curves
    >>> equator = ck.source("analytic.circle", normal=[0, 0, 1])
    >>> colours = {"left": "white", "right": ["lime", "blue", "lime"]}
    >>> found = diffusion_curves(ck.source("analytic.sphere"), [(equator, colours)], spacing=0.2)
    >>> (found.evaluate([[0, 0, 1], [0, 0, -1]]) + 1e-6).round(2).tolist()
    [[1.0, 1.0, 1.0], [0.0, 0.5, 0.5]]
    """
    scene = surface if isinstance(surface, ck.Scene) else ck.Scene(surface, ck.Laplace())
    named = curves if isinstance(curves, Mapping) else {f"curve {number}": pair for number, pair in enumerate(curves)}
    boundaries = [_boundary(name, pair) for name, pair in named.items()]
    if not any(curve.condition(side).kind == "dirichlet" for curve in boundaries for side in ("left", "right")):
        raise InputError("no side of a curve has a colour; give one at least.")
    whole = ck.Scene(scene.surface, ck.Laplace(), [*scene.boundaries, *boundaries], scene.edge)
    solution = ck.solve(whole, spacing, **options)
    _check_every_piece_coloured(solution)
    return ColouredSurface(solution, prescribed_range(whole, 0.25 * solution.spacing))


def _check_every_piece_coloured(solution: Solution) -> None:
    """Raise SceneError if colours are undetermined on a piece of the manifold: no side of a curve there has one."""
    free = [imbalance for imbalance in solution.imbalances if imbalance.of == "data"]
    if free:
        where, share = ", ".join(f"{x:.3g}" for x in free[0].near), 100 * free[0].share
        raise SceneError(
            f"a piece of the manifold about ({where}), {share:.0f} percent of it, touches no side of "
            "a curve that has a colour; give it one."
        )


def _boundary(name: str, pair: Any) -> ck.Boundary:
    """Return the boundary of a curve with the conditions of its colours; raise InputError for any other ``pair``."""
    if not isinstance(pair, (tuple, list)) or len(pair) != 2 or not isinstance(pair[0], ClosestPointSource):
        raise InputError(f"{name} must be a pair (source of a curve, its colours), got {shown(pair)}.")
    curve, colours = pair
    along = ArcLengthShare(curve)
    if not isinstance(colours, Mapping):
        return ck.Boundary(name, curve, both=_condition(colours, along, f"the colour of {name}"))
    if set(colours) != SIDES:
        raise InputError(
            f"colours of {name} are given as left and right, with None for a barrier, got "
            f"{', '.join(map(str, colours)) or 'none'}."
        )
    sides = {side: _condition(colours[side], along, f"the {side} colour of {name}") for side in ("left", "right")}
    return ck.Boundary(name, curve, **sides)


def _condition(colours: Any, along: ArcLengthShare, label: str) -> Any:
    """Return the condition of one side of a curve: the colours as Dirichlet data, zero flux if there are none."""
    return ck.Neumann(0.0) if colours is None else ck.Dirichlet(colour_data(colours, along, label))
