"""Named curves and surfaces: the ones of the literature on the closest point method."""

from __future__ import annotations

import ast
from collections.abc import Sequence
from math import gcd
from typing import Any

import numpy as np

from cpmkit.plugin import InputError, as_vector, formula_tree, positive, shown, whole
from cpmkit_parametric.factories import as_flag, as_range, build_source, curve, surface
from cpmkit_parametric.formulas import formula_map
from cpmkit_parametric.maps import Map, UnitMap
from cpmkit_parametric.sources import Curve, OrientedSurface, Surface

TURN_RANGE = [0.0, 2 * np.pi]
#: Of knots and planar curves: with more, the cells of :mod:`cpmkit_parametric.cells` do not resolve them.
MOST_WINDINGS = 1000


def torus_knot(*, a: Any = 3, b: Any = 7, major: Any = 3.0, minor: Any = 1.0, translation: Any = None) -> Curve:
    """Return the knot that winds ``a`` times about the axis and ``b`` times about the core of a torus, t in [0, 2 pi].

    King et al. (2024), eq. 21, where ``major`` is 3 and ``minor`` 1. The trefoil is a = 2, b = 3. Raise InputError if a
    value is not as stated, a and b share a factor, or the knot winds more often than 2^15 arcs resolve.

    Parameters
    ----------
    a : whole number
        How many times it winds about the axis, the z axis, from 1 to 1000.
    b : whole number
        How many times it winds about the core, from 1 to 1000.
    major : number
        Radius of the circle in the middle of the torus, its core.
    minor : number
        Radius of the torus's tube, above zero and smaller than ``major``.
    translation : (3,) numbers, optional
    """
    a, b = whole(a, "a", 1, MOST_WINDINGS), whole(b, "b", 1, MOST_WINDINGS)
    if gcd(a, b) != 1:
        raise InputError(f"a and b must share no factor, or the knot is traced more than once; got {a} and {b}.")
    R, r = positive(major, "major"), positive(minor, "minor")
    if r >= R:
        raise InputError(f"minor must be smaller than major, got {r:g} and {R:g}.")
    v = f"({R!r} + {r!r}*cos({b}*t))"
    return curve(
        x=[f"{v}*cos({a}*t)", f"{v}*sin({a}*t)", f"{r!r}*sin({b}*t)"],
        range=TURN_RANGE,
        periodic=True,
        translation=translation,
    )


def helix(*, radius: Any = 1.0, pitch: Any = 1.0, turns: Any = 2.0, translation: Any = None) -> Curve:
    """Return the helix about the z axis that starts at (radius, 0, 0) and rises by ``pitch`` a turn; t is the angle.

    Raise InputError if a number is not above zero, or there are more turns than 2^15 arcs resolve.

    Parameters
    ----------
    radius : number
        Of the cylinder that it winds around.
    pitch : number
        How far it climbs in a turn.
    turns : number
        How many turns it has, counterclockwise seen from above.
    translation : (3,) numbers, optional
    """
    rise = positive(pitch, "pitch") / (2 * np.pi)
    r, end = positive(radius, "radius"), 2 * np.pi * positive(turns, "turns")
    return curve(x=[f"{r!r}*cos(t)", f"{r!r}*sin(t)", f"{rise!r}*t"], range=[0.0, end], translation=translation)


def planar_curve(*, a: Any = 3, b: Any = 4, c: Any = -0.5, translation: Any = None) -> Curve:
    """Return the closed diffusion curve in the plane of King et al. (2024), eq. 22: (v cos t + c, v sin t + c).

    There v = (cos t ((a + b) / 2 + sin a t + sin b t) + (a + b) / 2) / (a + b), t in [0, 2 pi]. Raise InputError if a
    value is not as stated, or the curve bends more often than 2^15 arcs resolve.

    Parameters
    ----------
    a : whole number
        The first frequency of its lobes, from 1 to 1000.
    b : whole number
        The second frequency of its lobes, from 1 to 1000.
    c : number
        Added to both coordinates.
    translation : (2,) numbers, optional
    """
    a, b = whole(a, "a", 1, MOST_WINDINGS), whole(b, "b", 1, MOST_WINDINGS)
    shift = float(as_vector([c], 1, "c")[0])
    v = f"(cos(t)*({(a + b) / 2!r} + sin({a}*t) + sin({b}*t)) + {(a + b) / 2!r})/{a + b}"
    return curve(
        x=[f"{v}*cos(t) + {shift!r}", f"{v}*sin(t) + {shift!r}"],
        range=TURN_RANGE,
        periodic=True,
        translation=translation,
    )


def revolution(
    *, profile: Sequence[str], range: Any, periodic: bool = False, translation: Any = None
) -> OrientedSurface:
    """Return the surface that a profile sweeps about the z axis; u is the angle and v the profile's t.

    Normals point away from the axis where the height grows with t. Raise InputError if a value is not as stated, the
    distance is negative, the ends of a periodic profile do not meet, or the map is refused as by :func:`surface`.

    Parameters
    ----------
    profile : 2 formulas in t
        Distance from the axis, and height.
    range : two numbers
        Of t, or constant formulas such as ``"2*pi"``.
    periodic : bool
        The profile is closed, as a torus's.
    translation : (3,) numbers, optional
    """
    if isinstance(profile, str) or not isinstance(profile, Sequence) or len(profile) != 2:
        raise InputError(f"profile must be 2 formulas in t, [distance from the axis, height], got {shown(profile)}.")
    radius, height = (formula_tree(str(formula), ("t",), "profile") for formula in profile)
    start, end = as_range(range, "range")
    _check_radius(formula_map([radius], ("t",)), start, end)
    swept = formula_map([_times(radius, "cos(u)"), _times(radius, "sin(u)"), height], ("u", "t"))
    glued = [True, as_flag(periodic, "periodic")]
    unit = UnitMap(swept, np.array([0.0, start]), np.array([2 * np.pi, end]))
    source = build_source(unit, "ut", glued, translation=translation)
    assert isinstance(source, OrientedSurface)
    return source


def moebius(*, radius: Any = 1.0, half_width: Any = 0.35, translation: Any = None) -> Surface:
    """Return the Moebius strip about a core circle; u is the angle, v from -half_width to half_width.

    Raise InputError if a number is not as stated.

    Parameters
    ----------
    radius : number
        Of the circle in the middle of the strip, about the z axis, above zero.
    half_width : number
        Half the width of the strip, above zero and below ``radius``.
    translation : (3,) numbers, optional
    """
    R, w = positive(radius, "radius"), positive(half_width, "half_width")
    if w >= R:
        raise InputError(f"half_width must be smaller than radius, got {w:g} and {R:g}.")
    around = f"({R!r} + v*cos(u/2))"
    return surface(
        x=[f"{around}*cos(u)", f"{around}*sin(u)", "v*sin(u/2)"],
        u=TURN_RANGE,
        v=[-w, w],
        periodic_u=True,
        glue_u="flip",
        translation=translation,
    )


def klein(*, radius: Any = 2.0, width: Any = 1.0, translation: Any = None) -> Surface:
    """Return the figure-eight immersion of the Klein bottle: a figure eight of ``width`` that makes half a turn.

    With the angle u about z, the figure eight (width sin v, width sin 2v), turned by u / 2, is moved along a circle; u
    and v are in [0, 2 pi]. It crosses itself along the circle. Closest points know only the set of points in space, on
    which the two sheets meet there. It has no normals. Raise InputError if a number is not as stated.

    Parameters
    ----------
    radius : number
        Of the circle along which the figure of eight moves, above zero.
    width : number
        Size of the figure of eight, above zero and below 0.8 times ``radius``, as the figure reaches to 1.25 times it.
    translation : (3,) numbers, optional
    """
    R, w = positive(radius, "radius"), positive(width, "width")
    if w >= 0.8 * R:
        raise InputError(
            f"width must be below 0.8 times radius, {0.8 * R:g}, got {w:g}: the surface would reach the axis."
        )
    around = f"({R!r} + {w!r}*(cos(u/2)*sin(v) - sin(u/2)*sin(2*v)))"
    return surface(
        x=[f"{around}*cos(u)", f"{around}*sin(u)", f"{w!r}*(sin(u/2)*sin(v) + cos(u/2)*sin(2*v))"],
        u=TURN_RANGE,
        v=TURN_RANGE,
        periodic_u=True,
        periodic_v=True,
        glue_u="flip",
        translation=translation,
    )


def _times(tree: ast.expr, factor: str) -> ast.expr:
    return ast.BinOp(tree, ast.Mult(), formula_tree(factor, ("u",)))


def _check_radius(radius: Map, start: float, end: float) -> None:
    """Raise InputError if ``radius``, a map of t, is negative beyond rounding at one of 513 t in [start, end]."""
    at = radius.value(np.linspace(start, end, 513)[:, None])[:, 0]
    if np.nanmin(at) < -1e-12 * np.nanmax(np.abs(at)):
        raise InputError(
            f"profile must keep a distance from the axis of at least zero, got {np.nanmin(at):.3g}; the two halves "
            "of the surface would cross there."
        )
