"""The two general kinds: keyword arguments are the keys of a scene file.

Every kind takes ``translation`` besides, added after the map and without rounding its shape. Formulas use the
functions of every formula in a scene file. What is not accepted raises :class:`~cpmkit.errors.InputError`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from cpmkit.plugin import Bools, Floats, InputError, as_vector, formula_tree, shown
from cpmkit_parametric.cells import build_tree
from cpmkit_parametric.differences import Differences
from cpmkit_parametric.domain import Domain, check_gluing, find_sides
from cpmkit_parametric.formulas import evaluate_constant, formula_map
from cpmkit_parametric.maps import CallableMap, Map, UnitMap, as_coordinates
from cpmkit_parametric.sources import Curve, OrientedSurface, Parametric, PlaneCurve, Surface

Formulas = Sequence[str] | Callable[..., Any]
#: Given derivatives may differ from differences by this share of the largest.
DERIVATIVE_MISMATCH_SHARE = 1e-4


def curve(
    *, x: Formulas, range: Any, periodic: bool = False, derivatives: Any = None, translation: Any = None
) -> Curve:
    """Return the curve x(t), t in ``range``; ``local`` of its feet is t, and its tangents point to growing t.

    Parameters
    ----------
    x : 2 or 3 formulas in t, or callable
        ``x(t)`` of an array (n,) returns (n, d).
    range : two numbers
        Or constant formulas, such as ``"2*pi"``.
    periodic : bool
        The ends are one point.
    derivatives : callable, optional
        ``derivatives(t)`` returns x' and x'', each (n, d), for a callable x. Without it they are differences, for which
        a periodic x is called up to 0.4 percent beyond its range.
    translation : (d,) numbers, optional

    Raises
    ------
    InputError
        If a key is not accepted, the map is not finite or constant, or winds or bends more often than 2^15 cells of its
        range resolve, periodic ends do not meet to 1e-9 of the size, or derivatives differ from differences by 1e-4.
    """
    glued = [as_flag(periodic, "periodic")]
    source = build_source(_build_map(x, "t", (2, 3), [range], glued, derivatives), "t", glued, translation=translation)
    assert isinstance(source, Curve)
    return source


def surface(
    *,
    x: Formulas,
    u: Any,
    v: Any,
    periodic_u: bool = False,
    periodic_v: bool = False,
    glue_u: str = "straight",
    derivatives: Any = None,
    translation: Any = None,
) -> Surface:
    """Return the surface x(u, v); ``local`` of its feet is (u, v), and its normals are along x_u x x_v.

    Parameters
    ----------
    x : 3 formulas in u and v, or callable
        ``x(u, v)`` of arrays (n,) returns (n, 3).
    u, v : two numbers
        The ranges, or constant formulas such as ``"2*pi"``.
    periodic_u, periodic_v : bool
        The two ends are one curve.
    glue_u : "straight" or "flip"
        Flip: the ends of a periodic u are glued with v running backwards, as in a Moebius strip. The surface then has
        one side, and no normals.
    derivatives : callable, optional
        ``derivatives(u, v)`` returns x_u, x_v, x_uu, x_uv and x_vv, each (n, 3), for a callable x. Without it they are
        differences, for which x is called up to 0.4 percent beyond a periodic range.
    translation : (3,) numbers, optional

    Raises
    ------
    InputError
        If a key is not accepted, the map is not finite or constant along a parameter, or winds or bends more often than
        2^17 cells of its ranges resolve, periodic ends do not meet to 1e-9 of the size, or derivatives differ from
        differences by 1e-4.
    """
    if glue_u not in ("straight", "flip") or (glue_u == "flip" and not periodic_u):
        raise InputError(f"glue_u must be 'straight', or 'flip' with periodic_u = true, got {shown(glue_u)}.")
    glued = [as_flag(periodic_u, "periodic_u"), as_flag(periodic_v, "periodic_v")]
    source = build_source(
        _build_map(x, "uv", (3,), [u, v], glued, derivatives), "uv", glued, glue_u == "flip", translation
    )
    assert isinstance(source, Surface)
    return source


def build_source(
    map: UnitMap, names: str, periodic: Sequence[bool], flip: bool = False, translation: Any = None
) -> Parametric:
    """Return the source of ``map``, of a class with the abilities of its dimensions, moved by ``translation`` (d,).

    ``names`` are the parameters' letters, ``periodic`` (m,) says whose ends are glued, ``flip`` that those of the first
    are with the second reversed. Raise InputError if glued ends do not meet, or the map is not finite, is constant
    along a parameter, or winds more often than the cells of :func:`build_tree` resolve.
    """
    domain = Domain(np.array(periodic), flip)
    size = _image_diagonal(map)
    check_gluing(map, domain, names, size)
    shift = as_vector(np.zeros(map.dim) if translation is None else translation, map.dim, "translation")
    sides = find_sides(map, domain, size)
    domain = replace(domain, poles=sides.collapsed)
    kinds = {1: PlaneCurve if map.dim == 2 else Curve, 2: Surface if flip else OrientedSurface}
    return kinds[map.count](map, domain, sides, build_tree(map, domain), size, shift)


def _build_map(
    x: Any, names: str, counts: tuple[int, ...], ranges: Sequence[Any], periodic: Sequence[bool], derivatives: Any
) -> UnitMap:
    """Return the map of ``x``, formulas in the letters ``names`` or a callable, restated on [0, 1]^m.

    ``counts`` are the accepted numbers of coordinates, ``ranges`` m pairs of numbers or constant formulas; ``periodic``
    (m,) and ``derivatives``, callable or None, are for a callable x. Raise InputError for a value of another form.
    """
    wanted = " or ".join(map(str, counts))
    lower, upper = np.array(
        [as_range(r, n if names == "uv" else "range") for r, n in zip(ranges, names, strict=True)]
    ).T
    if callable(x):
        return UnitMap(_build_callable_map(x, lower, upper, np.array(periodic), derivatives, counts), lower, upper)
    if derivatives is not None:
        raise InputError("derivatives belong to a callable x; formulas are differentiated by themselves.")
    if isinstance(x, str) or not isinstance(x, Sequence) or len(x) not in counts or not _are_formulas(x):
        raise InputError(f"x must be {wanted} formulas in {' and '.join(names)}, or a callable, got {shown(x)}.")
    return UnitMap(formula_map([formula_tree(str(text), tuple(names)) for text in x], names), lower, upper)


def _are_formulas(x: Sequence[Any]) -> bool:
    return all(isinstance(text, (str, int, float)) and not isinstance(text, bool) for text in x)


def _build_callable_map(
    x: Callable[..., Any], lower: Floats, upper: Floats, periodic: Bools, derivatives: Any, counts: tuple[int, ...]
) -> Map:
    """Return the map of the callable ``x`` of m arrays (n,), with ``derivatives``, or differences where this is None.

    It is tried at seven parameters between ``lower`` and ``upper`` (m,). Raise InputError if a result has another
    shape, ``counts`` lacks its number of coordinates, or ``derivatives`` differ from differences.
    """
    probe = (lower + (upper - lower) * np.linspace(0.05, 0.95, 7)[:, None]).T
    dim = as_coordinates(x(*probe), probe.shape[1], counts[0] if len(counts) == 1 else None, "x").shape[1]
    if dim not in counts:
        raise InputError(f"x must return 2 or 3 coordinates, got {dim}.")
    differences = CallableMap(dim, len(lower), x, Differences(x, lower, upper, periodic))
    if derivatives is None:
        return differences
    if not callable(derivatives):
        raise InputError(f"derivatives must be a callable, got {shown(derivatives)}.")
    exact_map = CallableMap(dim, len(lower), x, derivatives)
    _check_derivatives(exact_map.jet(probe.T), differences.jet(probe.T), upper - lower)
    return exact_map


def _check_derivatives(exact: Any, differences: Any, width: Floats) -> None:
    """Raise InputError if derivatives, times ``width`` (m,) of the ranges, differ by 1e-4 of the largest."""
    scales = (width[:, None], (width[:, None] * width)[..., None])
    for order, scale, a, b in zip(("first", "second"), scales, exact[1:], differences[1:], strict=True):
        apart, largest = np.abs((a - b) * scale).max(), np.abs(b * scale).max()
        if not apart <= DERIVATIVE_MISMATCH_SHARE * largest:
            raise InputError(
                f"The {order} derivatives disagree with differences of x by {apart / (largest or 1.0):.2g} of the "
                "largest; correct derivatives, or leave it out."
            )


def as_range(value: Any, label: str) -> tuple[float, float]:
    """Return ``value`` as two ascending finite numbers; raise InputError, which names ``label``, if it is not."""
    if isinstance(value, str) or np.ndim(np.asarray(value, dtype=object)) != 1 or len(value) != 2:
        raise InputError(f"{label} must be two numbers [start, end], got {shown(value)}.")
    start, end = (as_number(entry, label) for entry in value)
    if not (np.isfinite([start, end]).all() and start < end):
        raise InputError(f"{label} must run from a smaller to a larger finite number, got {shown(value)}.")
    return start, end


def as_number(value: Any, label: str) -> float:
    """Return a number, be it finite or not, or the finite value of a constant formula; else raise InputError."""
    if isinstance(value, str):
        number = evaluate_constant(value, label)
        if not np.isfinite(number):
            raise InputError(f"{label} must hold finite numbers, got {shown(value)}, which is {number:g}.")
        return number
    if isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)):
        raise InputError(f"{label} must hold numbers or constant formulas, got {shown(value)}.")
    try:
        return float(value)
    except OverflowError:
        return np.inf


def as_flag(value: Any, label: str) -> bool:
    """Return ``value`` if it is True or False; raise InputError, which names ``label``, if it is neither."""
    if not isinstance(value, (bool, np.bool_)):
        raise InputError(f"{label} must be true or false, got {shown(value)}.")
    return bool(value)


def _image_diagonal(map: UnitMap) -> float:
    """Return the diagonal of the box of the image, measured at 513 parameters of a curve or 65 by 65 of a surface.

    Raise InputError if the map is not finite there, or constant along a parameter.
    """
    count = {1: 513, 2: 65}[map.count]
    s = np.stack(np.meshgrid(*[np.linspace(0, 1, count)] * map.count, indexing="ij"), axis=-1)
    points = map.value(s.reshape(-1, map.count))
    bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if len(bad):
        where = map.user_parameters(s.reshape(-1, map.count)[bad[:1]])[0].tolist()
        raise InputError(
            f"x is not finite at {len(bad)} of {len(points)} parameters, first at {where}; choose a range where it is."
        )
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    grid = points.reshape(*[count] * map.count, -1)
    lengths = [np.linalg.norm(np.diff(grid, axis=k), axis=-1).sum(axis=k).max() for k in range(map.count)]
    if min(lengths) <= 1e-12 * np.abs(points).max() or size == 0:
        raise InputError(
            "x is constant along a parameter: the image would have a lower dimension; correct the formulas."
        )
    return size
