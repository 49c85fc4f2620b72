"""The seven kinds: keyword arguments are the keys of a scene file.

All take ``trim``, a formula: of the level set the part with trim <= 0 is kept, and where it is cut is its edge; and
``resolution``, how many cells the lattice has, along the longest side of the bounds, from which samples are taken: a
part or a gap of the level set that is thinner than a cell may be overlooked.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from cpmkit.plugin import Floats, InputError, as_vector, existing_file, norms, positive, read_array, shown, whole
from cpmkit_levelset.fields import (
    GRADIENT_STEP_SHARE,
    HESSIAN_STEP_SHARE,
    Differences,
    Field,
    FunctionField,
    check_gradient,
)
from cpmkit_levelset.formulas import formula_field
from cpmkit_levelset.gridfield import STENCIL_NODES, GridField
from cpmkit_levelset.levelset import LevelSet, level_set

#: Cells of the lattice of samples along the longest side of the bounds.
DEFAULT_RESOLUTION = 64
#: Differences are judged by the worst but for one sample in twenty: phi may have a crease somewhere.
SLOPE_ERROR_QUANTILE = 0.95


def expression(*, phi: Any, bounds: Any, trim: Any = None, resolution: Any = DEFAULT_RESOLUTION) -> LevelSet:
    """Return the zero set of a formula.

    Raise SceneError if a formula does not parse, is constant, or uses what is not offered. Raise InputError if another
    key does not hold what is accepted, phi is not finite in the bounds, there is no zero set in them or it runs out of
    them, or trim leaves nothing of it, or cuts a curve at more than two points.

    Parameters
    ----------
    phi : str or SymPy expression
        In x, y and, in space, z. ``abs``, ``minimum`` and ``maximum`` make creases; what jumps (floor, sign, %,
        comparisons) is refused.
    bounds : (2, d) numbers
        The lower and upper corner of a box that holds the zero set.
    trim : str, optional
        Keeps the part with trim <= 0; the rest may run out of the bounds.
    resolution : int
        Cells of the lattice of samples along the longest side, 8 to 512; thinner parts or gaps may be overlooked.
    """
    box = as_box(bounds)
    if callable(phi) and not hasattr(phi, "free_symbols"):
        raise InputError(
            f"phi of levelset.expression must be a formula, got {shown(phi)}; levelset.callable takes functions."
        )
    text = str(phi) if hasattr(phi, "free_symbols") else phi  # SymPy writes formulas as scene files do
    return _build_level_set(formula_field(text, box.shape[1], "phi"), trim, box, resolution)


def function(
    *,
    phi: Callable[[Floats], Any],
    gradient: Callable[[Floats], Any] | None = None,
    bounds: Any,
    hessian: Callable[[Floats], Any] | None = None,
    trim: Any = None,
    resolution: Any = DEFAULT_RESOLUTION,
) -> LevelSet:
    """Return the zero set of a Python function.

    Raise InputError if a function is none, returns another shape, or ``gradient`` is not the gradient of ``phi``; or as
    for :func:`expression`.

    Parameters
    ----------
    phi : callable
        Of points (n, d), returns (n,): a signed distance, or any other smooth function.
    gradient : callable, optional
        Returns (n, d). Feet are as good as the gradient is, so it must be exact. Without it, fourth-order central
        differences of phi are taken; where these are off by more than a millionth, solutions warn of it.
    bounds : (2, d) numbers
        The lower and upper corner of a box that holds the zero set.
    hessian : callable, optional
        Returns (n, d, d). Without it, fourth-order central differences of the gradient are taken, which cost 4 d calls
        of it for each of Newton's steps but no accuracy.
    trim : str, optional
        A formula in x, y, z: the part with trim <= 0 is kept.
    resolution : int
        Cells of the lattice of samples along the longest side of the bounds, 8 to 512.
    """
    box = as_box(bounds)
    for name, function_given in (("phi", phi), ("gradient", gradient), ("hessian", hessian)):
        if not (callable(function_given) or (name != "phi" and function_given is None)):
            raise InputError(
                f"{name} of levelset.callable must be a function of points (n, d), got {shown(function_given)}; "
                "levelset.expression takes formulas."
            )
    size = float(norms((box[1] - box[0])[None])[0])
    differences = Differences(phi, box.shape[1], GRADIENT_STEP_SHARE * size)
    step = (GRADIENT_STEP_SHARE if gradient is None else HESSIAN_STEP_SHARE) * size
    field = FunctionField(box.shape[1], phi, gradient or differences, hessian, step)
    if gradient is not None:
        check_gradient(field, box)
        return _build_level_set(field, trim, box, resolution)
    level_set_source = _build_level_set(field, trim, box, resolution)
    return replace(
        level_set_source,
        slope_error=float(np.quantile(differences.errors(_sample_subset(level_set_source)), SLOPE_ERROR_QUANTILE)),
    )


def grid(
    *,
    spacing: Any,
    values: Any = None,
    file: str | Path | None = None,
    origin: Any = None,
    trim: Any = None,
    resolution: Any = DEFAULT_RESOLUTION,
) -> LevelSet:
    """Return the zero set of a function that is given on a regular grid.

    Raise InputError if both or neither of values and file are given, the file cannot be read, or the array does not
    hold what is accepted; or as for :func:`expression`.

    Parameters
    ----------
    spacing : number or d numbers
        The distance of neighbouring grid points, above zero.
    values : (n0, n1[, n2]) array
        phi at origin + spacing * (i, j, k), for ``values[i, j, k]``; at least six along each axis.
    file : str or Path
        A ``.npy`` file with such an array, instead.
    origin : (d,) numbers, optional
        Zero unless given.
    trim : str, optional
        A formula in x, y, z: the part with trim <= 0 is kept.
    resolution : int
        Cells of the lattice of samples along the longest side of the grid, 8 to 512.
    """
    if (values is None) == (file is None):
        raise InputError(f"levelset.grid takes either values or a file, got {'neither' if file is None else 'both'}.")
    samples = _as_grid_values(read_array(existing_file(file), "an array of numbers") if values is None else values)
    d = samples.ndim
    single = not isinstance(spacing, (list, tuple)) and np.ndim(spacing) == 0
    steps = np.full(d, positive(spacing, "spacing")) if single else as_vector(spacing, d, "spacing")
    if not (steps > 0).all():
        raise InputError(f"spacing must be above zero, got {shown(spacing)}.")
    field = GridField(samples, np.zeros(d) if origin is None else as_vector(origin, d, "origin"), steps)
    level_set_source = _build_level_set(field, trim, field.box, resolution)
    return replace(level_set_source, slope_error=field.slope_error(_sample_subset(level_set_source)))


def dziuk(*, trim: Any = None, resolution: Any = DEFAULT_RESOLUTION) -> LevelSet:
    """Return the surface (x - z^2)^2 + y^2 + z^2 = 1 (Dziuk, 1988).

    ``trim`` is a formula, <= 0 on the part kept; ``resolution``, 8 to 512, counts sample cells along the longest side.
    """
    phi, box = "(x - z**2)**2 + y**2 + z**2 - 1", [[-1.1, -1.1, -1.1], [1.35, 1.1, 1.1]]
    return expression(phi=phi, bounds=box, trim=trim, resolution=resolution)


def decotetrahedron(*, trim: Any = None, resolution: Any = DEFAULT_RESOLUTION) -> LevelSet:
    """Return a surface with four lobes on a hollow body (King et al. (2024), section 7.2, after 3D-XplorMath).

    On it the sum of (x_i - 2)^2 (x_i + 2)^2 - 10 x_i^2, plus 3 (x^2 y^2 + x^2 z^2 + y^2 z^2) + 6 x y z, is -22; its
    size is about 6. ``trim`` is a formula, <= 0 on the part kept; ``resolution``, 8 to 512, counts sample cells along
    the longest side.
    """
    lobes = " + ".join(f"({c} - 2)**2*({c} + 2)**2 - 10*{c}**2" for c in "xyz")
    phi = f"{lobes} + 3*(x**2*y**2 + x**2*z**2 + y**2*z**2) + 6*x*y*z + 22"
    return expression(phi=phi, bounds=[[-4.0] * 3, [4.0] * 3], trim=trim, resolution=resolution)


def tooth(*, trim: Any = None, resolution: Any = DEFAULT_RESOLUTION) -> LevelSet:
    """Return the surface x^4 + y^4 + z^4 = x^2 + y^2 + z^2, without the isolated point at the origin.

    ``trim`` is a formula, <= 0 on the part kept; ``resolution``, 8 to 512, counts sample cells along the longest side.
    """
    phi = "x**4 + y**4 + z**4 - (x**2 + y**2 + z**2)"
    return expression(phi=phi, bounds=[[-1.25] * 3, [1.25] * 3], trim=trim, resolution=resolution)


def goursat(
    *, a: Any = 0.0, b: Any = -5.0, c: Any = 11.8, trim: Any = None, resolution: Any = DEFAULT_RESOLUTION
) -> LevelSet:
    """Return the surface x^4 + y^4 + z^4 + a (x^2 + y^2 + z^2)^2 + b (x^2 + y^2 + z^2) + c = 0 (Goursat, 1887).

    The defaults give the tangle cube. ``trim`` is a formula, <= 0 on the part that is kept, ``resolution`` the
    lattice's cells along the longest side, 8 to 512. Raise InputError if the numbers give no bounded surface.

    Parameters
    ----------
    a : number
        Factor of the square of the squared distance, above -1/3.
    b : number
        Factor of the squared distance from the origin.
    c : number
        Constant of the polynomial.
    """
    a, b, c = (float(number) for number in as_vector([a, b, c], 3, "[a, b, c]"))
    lead = a + 1 / 3  # the quartic part on the unit sphere is least along the diagonals
    root = b * b - 4 * lead * c if lead > 0 else -1.0
    square = (np.sqrt(root) - b) / (2 * lead) if root >= 0 else -1.0
    if square <= 0:
        raise InputError(f"a={a:g}, b={b:g}, c={c:g} give no bounded surface; use a > -1/3, and b or c below zero.")
    radius = 1.02 * float(np.sqrt(square))
    sphere = "(x**2 + y**2 + z**2)"
    phi = f"x**4 + y**4 + z**4 + ({a!r})*{sphere}**2 + ({b!r})*{sphere} + ({c!r})"
    return expression(phi=phi, bounds=[[-radius] * 3, [radius] * 3], trim=trim, resolution=resolution)


def as_box(bounds: Any) -> Floats:
    """Return ``bounds``, a lower and an upper corner, as a (2, d) array, d = 2 or 3; raise InputError if it is not."""
    try:
        lower, upper = bounds
        dim = 2 if len(lower) == 2 else 3
        box = np.stack([as_vector(corner, dim, "a corner") for corner in (lower, upper)])
    except (TypeError, ValueError) as error:  # InputError is a ValueError
        raise InputError(f"bounds must be two corners of 2 or 3 finite numbers, got {shown(bounds)}.") from error
    if not (box[0] < box[1]).all():
        raise InputError(
            f"bounds must hold the lower corner, then one above it in each coordinate, got {shown(bounds)}."
        )
    return box


def _build_level_set(field: Field, trim: Any, box: Floats, resolution: Any) -> LevelSet:
    cells = whole(resolution, "resolution", 8, 512)
    return level_set(field, None if trim is None else formula_field(trim, field.dim, "trim"), box, cells)


def _sample_subset(level_set_source: LevelSet) -> Floats:
    """Return samples (n, d) of the level set's first face: 2000 to 4000, or all if there are fewer."""
    samples = level_set_source.surface.layers[0].samples
    return samples[:: max(len(samples) // 2000, 1)]


def _as_grid_values(values: Any) -> Floats:
    """Return ``values`` as finite float64, (n0, n1[, n2]), each at least six; raise InputError if they are not."""
    try:
        samples = np.ascontiguousarray(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"values must be an array of numbers, got {type(values).__name__}.") from error
    if samples.ndim not in (2, 3) or min(samples.shape) < STENCIL_NODES:
        raise InputError(
            f"values must have 2 or 3 axes with {STENCIL_NODES} grid points or more, got shape {samples.shape}."
        )
    bad = int((~np.isfinite(samples)).sum())
    if bad:
        raise InputError(f"values must be finite: {bad} of {samples.size} are NaN or infinite.")
    return samples
