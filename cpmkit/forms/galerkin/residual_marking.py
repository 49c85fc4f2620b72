"""Marking of patches for refinement, by the residual of the equation.

The square of ``h_l^2 (f + div(a grad u) - c u)``, integrated over a patch of level l, is in proportion to the square of
the error that its size leaves there. It indicates where the error is large, not how large it is.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from cpmkit.forms.galerkin.refinement.refined_space import RefinedDofMap
from cpmkit.forms.galerkin.space.quantised_samples import SAMPLES_AT_ONCE
from cpmkit.forms.galerkin.space.sample_kernels import spline_slopes, spline_values
from cpmkit.runtime.compilation import compiled
from cpmkit.scene.data import evaluate_data
from cpmkit.types import Bools, Floats, Ints

if TYPE_CHECKING:
    from cpmkit.forms.galerkin.form import Galerkin

#: Marked patches hold this share of the sum of squares.
MARKED_SHARE = 0.5
#: The gradient of the diffusivity is a difference over this share of the spacing.
SLOPE_STEP_SHARE = 1e-3
#: The order with which local errors fall with the size of patches.
ORDER = 3.0


def residual_squares(form: Galerkin, u: Floats) -> Floats:
    """Return (p,) the integrals over the patches of the square of h_l^2 times the residual of ``u`` (n, channels).

    h_l, the spacing of a patch, is in units of h. The square of each channel is divided by its integral over the
    manifold, so that the result does not depend on the units of channels.
    """
    squares = _residual(form, u) ** 2
    sums = form.point_weights @ squares
    shares = squares @ (1 / np.where(sums > 0, sums, 1.0)) * form.point_weights
    dof_map = _refined_dof_map(form)
    lengths = 0.5**dof_map.levels
    return np.bincount(dof_map.patch[: len(shares)], shares, minlength=len(dof_map.cells)) * lengths**4


def _refined_dof_map(form: Galerkin) -> RefinedDofMap:
    """Return the dof map of a form on refined splines."""
    assert isinstance(form.space.dof_map, RefinedDofMap)
    return form.space.dof_map


def _residual(form: Galerkin, u: Floats) -> Floats:
    """Return (p, channels) ``f + a Lap u + grad a . grad u - c u`` at the samples of the manifold."""
    terms, points = form.scene.problem.terms(), form.points.copy()
    f = evaluate_data(terms.f, points, u.shape[1], "the right-hand side f")
    c = evaluate_data(terms.c, points, 1, "the factor c")
    a = evaluate_data(terms.diffusivity, points, 1, "the diffusivity")
    residual = f + a * _laplacian(form, u) - c * form.at_points(u)
    if callable(terms.diffusivity):
        slopes = [_slope(terms.diffusivity, points, form.spacing, axis) for axis in range(points.shape[1])]
        residual += np.einsum("pd,pcd->pc", np.stack(slopes, axis=1), form.gradient(u))
    return np.asarray(residual)


def _slope(a: Any, points: Floats, spacing: float, axis: int) -> Floats:
    """Return (p,) the derivative of the function ``a`` along an ``axis`` at ``points``, by a central difference."""
    step = SLOPE_STEP_SHARE * spacing * np.eye(points.shape[1])[axis]
    ahead, behind = (evaluate_data(a, points + sign * step, 1, "the diffusivity")[:, 0] for sign in (1, -1))
    return np.asarray((ahead - behind) / (2 * SLOPE_STEP_SHARE * spacing))


def _laplacian(form: Galerkin, u: Floats) -> Floats:
    """Return (p, channels) Lap u at the samples: the sum of the second derivatives of u (n, channels) on tangents."""
    dof_map, samples = _refined_dof_map(form), form.sampled.samples
    coefficients, laplacian = form.space.to_coefficients(u), np.empty((form.sampled.interior, u.shape[1]))
    for start in range(0, len(laplacian), SAMPLES_AT_ONCE):
        some = slice(start, min(start + SAMPLES_AT_ONCE, len(laplacian)))
        patch = dof_map.patch[some]
        at = np.ascontiguousarray(dof_map.magnify(patch, samples.points_at(some)))
        normals, magnified = np.ascontiguousarray(samples.normals_at(some)), np.empty((len(patch), u.shape[1]))
        lattice = dof_map.unknowns, dof_map.cells, dof_map.spacing
        second_derivatives(*lattice, patch, at, normals, coefficients, magnified)
        laplacian[some] = magnified * dof_map.magnification(patch)[:, None] ** 2
    return laplacian


@compiled
def second_derivatives(
    unknowns: Ints, cells: Ints, spacing: float, patch: Any, points: Floats, normals: Floats, u: Floats, found: Floats
) -> None:
    """Fill ``found`` (q, channels) with tr(P H P), the sum of second derivatives along tangents, at ``points`` (q, d).

    H is the Hessian of the splines with the coefficients u (n, channels), P the projection on tangents. The points lie
    in the patches ``patch`` (q,) and have the orthonormal ``normals`` (q, c, d); ``unknowns`` (p, 3^d) and ``cells``
    (p, d) are those of the patches.
    """
    d, width = cells.shape[1], unknowns.shape[1]
    splines = np.empty((3, 3, 3))  # by order of the derivative, axis, place
    splines[:] = 1.0
    hessian = np.empty((d, d))
    for q in range(len(points)):
        p = patch[q]
        for axis in range(d):
            t = points[q, axis] / spacing - cells[p, axis] + 0.5
            spline_values(t, 3, splines[0, axis])
            spline_slopes(t, 3, splines[1, axis])
            splines[2, axis, 0], splines[2, axis, 1], splines[2, axis, 2] = 1.0, -2.0, 1.0
        for channel in range(u.shape[1]):
            hessian[:] = 0.0
            for place in range(width):
                value = u[unknowns[p, place], channel]
                for i in range(d):
                    for j in range(i, d):
                        product, rest = value, place
                        for axis in range(d - 1, -1, -1):
                            product *= splines[(axis == i) + (axis == j), axis, rest % 3]
                            rest //= 3
                        hessian[i, j] += product
            total = 0.0
            for i in range(d):
                total += hessian[i, i]
            for c in range(normals.shape[1]):
                for i in range(d):
                    total -= normals[q, c, i] ** 2 * hessian[i, i]
                    for j in range(i + 1, d):
                        total -= 2.0 * normals[q, c, i] * normals[q, c, j] * hessian[i, j]
            found[q, channel] = total / spacing**2


def mark_patches(squares: Floats) -> Bools:
    """Return (p,) which patches are marked: those with the largest ``squares`` that hold half the sum (Doerfler)."""
    order = np.argsort(-squares, kind="stable")
    total = np.cumsum(squares[order])
    marked = np.zeros(len(squares), dtype=bool)
    if total[-1] > 0:
        marked[order[: int(np.searchsorted(total, MARKED_SHARE * total[-1])) + 1]] = True
    return marked


def expected_gain(form: Galerkin, squares: Floats) -> float:
    """Return by which factor patches of adapted sizes are expected to reduce the unknowns at the same error.

    With squares e_p of patches of areas w_p at size h that fall like h^(2 k), and unknowns like h^-2, the fewest
    unknowns for a given sum of squares are those at sizes h_p^2 in proportion to (w_p / e_p)^(1 / (k + 1)): the gain is
    ``(sum w)(sum e)^(1/k) / (sum w^(k/(k+1)) e^(1/(k+1)))^((k+1)/k)``.
    """
    dof_map, k = form.space.dof_map, ORDER
    area = np.bincount(dof_map.patch, form.sampled.samples.weights, minlength=len(dof_map.cells))
    if not squares.sum() > 0:
        return 1.0
    best = np.sum(area ** (k / (k + 1)) * squares ** (1 / (k + 1))) ** ((k + 1) / k)
    return float(area.sum() * squares.sum() ** (1 / k) / best)
