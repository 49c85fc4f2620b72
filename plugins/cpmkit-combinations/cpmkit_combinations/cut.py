"""The kinds ``cut.plane`` and ``cut.function``: the zeros of a function of position on a surface or curve."""

from __future__ import annotations

from typing import Any

import numpy as np

from cpmkit.plugin import ClosestPointSource, Floats, InputError, as_source, as_vector, check_source, localize, whole
from cpmkit_combinations.crossings import find_crossings, select_apart
from cpmkit_combinations.curve import TracedCurve
from cpmkit_combinations.level_cut import LevelCut, PositionFunction, plane_distance, position_function
from cpmkit_combinations.moved import Moved, moved_source
from cpmkit_combinations.points import PointSet
from cpmkit_combinations.tracing import trace_cut

#: Default number of samples along the largest side of a surface, and of a curve.
SURFACE_RESOLUTION, CURVE_RESOLUTION = 128, 1024
#: Zeros on a curve nearer than this, relative to the size, are the same.
SAME_ZERO_SHARE = 1e-9
#: Where phi touches zero, its gradient along the curve is below this share of that in space.
TOUCHING_SLOPE_SHARE = 1e-6


def plane_cut(
    *, surface: ClosestPointSource, point: Any, normal: Any, resolution: int | None = None
) -> ClosestPointSource:
    """Return the intersection of a surface, or of a curve, with a plane (in 2D a line).

    A triangle mesh is cut edge by edge. The plane may pass through its vertices, along edges, or contain faces, whose
    outline is then the cut. Raise InputError if an argument is not accepted, or the plane misses the surface, only
    touches it, or cuts it in a curve that branches or is too small or too sharply curved for the samples.

    Parameters
    ----------
    surface : source or mesh
        A surface, whose intersection is a curve, or a curve, whose intersection is a set of points.
    point, normal : (d,) numbers
        A point of the plane, and its normal, of any length. It points to the left of the cut of a surface; the left of
        points on a curve is where the curve comes from.
    resolution : int, optional
        Number of samples along the largest side of the surface, at least 8, by default 128 (1024 on a curve). Pieces
        of the cut smaller than a few samples may be missed, and parts nearer than that refused. A triangle mesh needs
        no samples and ignores it.

    Examples
    --------
    >>> import numpy as np, cpmkit as ck
    >>> ring = plane_cut(surface=ck.source("analytic.sphere"), point=[0, 0, 0.6], normal=[0, 0, 1])
    >>> ring.closest_point(np.array([[2.0, 0, 0]])).points[0, [0, 2]].round(12).tolist()
    [0.8, 0.6]
    """
    surface = as_cuttable(surface, "surface")
    plane = plane_distance(point, normal, surface.dim)
    through, across = as_vector(point, surface.dim, "point"), as_vector(normal, surface.dim, "normal")
    section = _section_by_source(surface, through, across)
    if section is not None:
        return section
    return find_zero_set(level_cut(surface, plane, "the distance from the plane", resolution))


def _section_by_source(surface: Any, point: Floats, normal: Floats) -> ClosestPointSource | None:
    """Return the section by a source's own method ``plane_section``; None if it has none.

    ``point`` and ``normal`` (d,) define the plane; that of a moved source is transformed to the source inside.
    """
    if isinstance(surface, Moved):
        rotation = surface.rotation
        inner_point = (rotation.T @ (point - surface.translation)) / surface.scale
        section = _section_by_source(surface.of, inner_point, rotation.T @ normal)
        motion = {"rotation": rotation, "translation": surface.translation, "scale": surface.scale}
        return None if section is None else moved_source(of=section, **motion)
    if not hasattr(surface, "plane_section"):
        return None
    own_section: ClosestPointSource = surface.plane_section(point, normal)
    return own_section


def function_cut(*, surface: ClosestPointSource, phi: Any, resolution: int | None = None) -> TracedCurve | PointSet:
    """Return the points of a surface, or of a curve, at which a function vanishes and changes its sign.

    Where it jumps over zero there is no point. Raise InputError if an argument is not accepted, or phi is not finite on
    the surface, keeps its sign or only jumps, vanishes on a curve that branches or is too small or too sharply curved
    for the samples, or has no slope at a zero on a curve, which it may only touch.

    Parameters
    ----------
    surface : source or mesh
        A surface, whose intersection is a curve, or a curve, whose intersection is a set of points.
    phi : str or callable
        A formula in x, y, z, or a function of points (n, d) that returns (n,); defined in space a little around
        the surface, smooth where it vanishes. The left of the cut of a surface is where it is positive; the left of
        points on a curve is where the curve comes from.
    resolution : int, optional
        As for :func:`plane_cut`, also on a triangle mesh.

    Examples
    --------
    >>> import numpy as np, cpmkit as ck
    >>> waves = function_cut(surface=ck.source("analytic.torus"), phi="z - 0.1 * sin(3 * x)")
    >>> waves.deviation < 1e-11
    True
    """
    surface = as_cuttable(surface, "surface")
    return find_zero_set(level_cut(surface, position_function(phi, surface.dim, "phi"), "phi", resolution))


def find_zero_set(cut: LevelCut) -> TracedCurve | PointSet:
    """Return the zeros of the function of ``cut``: on a surface a traced curve, on a curve a set of points."""
    return _cut_points(cut) if cut.surface.manifold_dim == 1 else TracedCurve(trace_cut(cut), cut.phi.origin)


def level_cut(surface: ClosestPointSource, function: Any, label: str, resolution: int | None) -> LevelCut:
    """Return the cut of ``surface`` by ``function``, relative to the centre of the surface's bounds.

    ``label`` names the function in messages; ``resolution`` is the number of samples along the largest side, None for
    the default. Raise InputError if it is not a whole number of 8 or more, or the bounds have no extent.
    """
    bounds = np.asarray(surface.bounds, dtype=np.float64)
    origin, sides = 0.5 * (bounds[0] + bounds[1]), bounds[1] - bounds[0]
    default = CURVE_RESOLUTION if surface.manifold_dim == 1 else SURFACE_RESOLUTION
    count = default if resolution is None else whole(resolution, "resolution", 8)
    spacing = float(sides.max()) / count
    if not spacing > 0:
        raise InputError("surface must have an extent to be cut, got bounds of no size.")
    phi = PositionFunction(function, origin, label)
    return LevelCut(localize(surface, origin), phi, float(np.linalg.norm(sides)), spacing)


def _cut_points(cut: LevelCut) -> PointSet:
    """Return the zeros on a curve, in lexicographic order.

    Raise InputError where the function has no slope at a zero, and as :func:`find_crossings`.
    """
    feet = find_crossings(cut).inside
    _, _, share = cut.directions(feet)
    if (share < TOUCHING_SLOPE_SHARE).any():
        place = (feet.points[np.argmin(share)] + cut.phi.origin).tolist()
        raise InputError(f"{cut.phi.label} does not cut the curve at {place}, it touches it there; change it a little.")
    places = feet.points[select_apart(feet.points, SAME_ZERO_SHARE * cut.size)]
    return PointSet(places[np.lexsort(places.T[::-1])], cut.phi.origin)


def as_cuttable(surface: Any, label: str) -> Any:
    """Return the source of a curve or surface, given as one or as a mesh; raise InputError, which names ``label``."""
    surface = as_source(surface)
    check_source(surface, label)
    if surface.manifold_dim not in (1, 2):
        kind = "a mixed union" if surface.manifold_dim is None else f"of dimension {surface.manifold_dim}"
        wall = "; a wall in a solid is a surface of its own, such as two triangles of the kind 'mesh.triangles'"
        raise InputError(
            f"{label} must be a surface or a curve, got a source that is {kind}{wall if surface.manifold_dim else ''}."
        )
    return surface
