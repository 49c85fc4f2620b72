"""The kinds ``cut.plane`` and ``cut.function``: where a function of position vanishes on a surface or curve."""

from __future__ import annotations

from typing import Any

import numpy as np

from cpmkit.plugin import ClosestPointSource, CutsItself, Floats, InputError, as_vector, check_source, localize, whole
from cpmkit_combinations.crossings import crossings, spaced_apart
from cpmkit_combinations.curve import TracedCurve
from cpmkit_combinations.level_cut import LevelCut
from cpmkit_combinations.motion import Moved, moved
from cpmkit_combinations.points import PointSet
from cpmkit_combinations.position_function import PositionFunction, plane_distance, position_function
from cpmkit_combinations.tracing import trace

#: Samples along the largest side of a surface, and of a curve, unless ``resolution`` says otherwise.
SURFACE_RESOLUTION, CURVE_RESOLUTION = 128, 1024
#: Zeros on a curve nearer than this, relative to the size, are one.
SAME_ZERO_SHARE = 1e-9
#: Of points at which phi touches zero or nearly so, its gradient along the curve is below this share of that in space.
TOUCHING_SLOPE_SHARE = 1e-6


def plane_cut(
    *, surface: ClosestPointSource, point: Any, normal: Any, resolution: int | None = None
) -> ClosestPointSource:
    """Return the intersection of a surface, or of a curve, with a plane (in 2D a line).

    A triangle mesh is cut edge by edge, whatever the plane: where it passes through vertices, along edges, or contains
    faces, of which the cut is the outline.

    Parameters
    ----------
    surface : source
        A surface, whose intersection is a curve, or a curve, whose intersection is a set of points.
    point, normal : (d,) numbers
        A point of the plane, and the direction across it, of any length. The left of a curve is where the
        normal points; that of points on a curve is where the curve comes from.
    resolution : int, optional
        Samples along the largest side of the surface, 128 unless given (1024 on a curve). Pieces of the cut smaller
        than a few samples may be missed, and parts nearer than that refused.

    Raises
    ------
    InputError
        If an argument is not accepted, or the plane misses the surface, only touches it, or cuts it in a curve that
        branches.

    Examples
    --------
    >>> import numpy as np, cpmkit as ck
    >>> ring = plane_cut(surface=ck.source("analytic.sphere"), point=[0, 0, 0.6], normal=[0, 0, 1])
    >>> ring.closest_point(np.array([[2.0, 0, 0]])).points[0, [0, 2]].round(12).tolist()
    [0.8, 0.6]
    """
    check_cuttable(surface, "surface")
    plane = plane_distance(point, normal, surface.dim)
    through, across = as_vector(point, surface.dim, "point"), as_vector(normal, surface.dim, "normal")
    own = _own_section(surface, through, across)
    if own is not None:
        return own
    return cut_of(level_cut(surface, plane, "the distance from the plane", resolution))


def _own_section(surface: Any, point: Floats, normal: Floats) -> ClosestPointSource | None:
    """Return the section that a surface finds itself, or what it was moved from; None where it finds none."""
    if isinstance(surface, Moved):
        turn = surface.rotation
        own = (turn.T @ (point - surface.translation)) / surface.scale
        found = _own_section(surface.of, own, turn.T @ normal)
        places = {"rotation": turn, "translation": surface.translation, "scale": surface.scale}
        return None if found is None else moved(of=found, **places)
    return surface.plane_section(point, normal) if isinstance(surface, CutsItself) else None


def function_cut(*, surface: ClosestPointSource, phi: Any, resolution: int | None = None) -> TracedCurve | PointSet:
    """Return the points of a surface, or of a curve, at which a function vanishes and changes its sign.

    Parameters
    ----------
    surface : source
        A surface, whose intersection is a curve, or a curve, whose intersection is a set of points.
    phi : str or callable
        A formula in x, y, z, or a function of points (n, d) that returns (n,); defined in space a little around
        the surface, smooth where it vanishes. The left of a curve is where it is positive; that of points on a
        curve is where the curve comes from.
    resolution : int, optional
        As for :func:`plane_cut`.

    Raises
    ------
    InputError
        If an argument is not accepted, or phi keeps its sign on the surface, or vanishes on a curve that branches.

    Examples
    --------
    >>> import numpy as np, cpmkit as ck
    >>> waves = function_cut(surface=ck.source("analytic.torus"), phi="z - 0.1 * sin(3 * x)")
    >>> waves.deviation < 1e-11
    True
    """
    check_cuttable(surface, "surface")
    return cut_of(level_cut(surface, position_function(phi, surface.dim, "phi"), "phi", resolution))


def cut_of(cut: LevelCut) -> TracedCurve | PointSet:
    """Return the points at which the function vanishes: of a surface a curve, of a curve a set of points."""
    return _points(cut) if cut.surface.manifold_dim == 1 else TracedCurve(trace(cut), cut.phi.origin)


def level_cut(surface: ClosestPointSource, function: Any, what: str, resolution: int | None) -> LevelCut:
    """Return the cut of ``surface`` where ``function`` vanishes, called ``what`` in messages.

    It is stated in coordinates relative to the centre of the surface's bounds.
    """
    bounds = np.asarray(surface.bounds, dtype=np.float64)
    origin, sides = 0.5 * (bounds[0] + bounds[1]), bounds[1] - bounds[0]
    usual = CURVE_RESOLUTION if surface.manifold_dim == 1 else SURFACE_RESOLUTION
    count = usual if resolution is None else whole(resolution, "resolution", 8)
    spacing = float(sides.max()) / count
    if not spacing > 0:
        raise InputError("surface must have an extent to be cut, got bounds of no size.")
    phi = PositionFunction(function, origin, what)
    return LevelCut(localize(surface, origin), phi, float(np.linalg.norm(sides)), spacing)


def _points(cut: LevelCut) -> PointSet:
    """Return the zeros on a curve, by increasing coordinates."""
    feet = crossings(cut).inside
    _, _, share = cut.directions(feet)
    if (share < TOUCHING_SLOPE_SHARE).any():
        place = (feet.points[np.argmin(share)] + cut.phi.origin).tolist()
        raise InputError(f"{cut.phi.what} does not cut the curve at {place}, it touches it there; change it a little.")
    places = feet.points[spaced_apart(feet.points, SAME_ZERO_SHARE * cut.size)]
    return PointSet(places[np.lexsort(places.T[::-1])], cut.phi.origin)


def check_cuttable(surface: Any, what: str) -> None:
    """Refuse what is no surface and no curve.

    Raises
    ------
    InputError
        If ``surface``, called ``what`` in the message, is no source or of another dimension.
    """
    check_source(surface, what)
    if surface.manifold_dim not in (1, 2):
        kind = "a mixed union" if surface.manifold_dim is None else f"of dimension {surface.manifold_dim}"
        raise InputError(f"{what} must be a surface or a curve, got a source that is {kind}.")
