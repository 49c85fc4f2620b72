"""Which patches are to be parted: those that hold half of what the residual says the error is.

The square of ``h_l^2 (f + div(a grad u) - c u)``, integrated over a patch of level l, is in proportion to the square of
the error that its size leaves there. It marks; it does not tell how large the error is.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cpmkit.forms.galerkin.quadrature.samples import SAMPLES_AT_ONCE
from cpmkit.forms.galerkin.refinement.refined import RefinedGalerkin
from cpmkit.forms.galerkin.space.sample_kernels import spline_slopes, spline_values
from cpmkit.runtime.compilation import compiled
from cpmkit.scene.data import evaluate_data
from cpmkit.types import Bools, Floats, Ints


@compiled
def second_derivatives(
    unknowns: Ints, cells: Ints, spacing: float, patch: Any, points: Floats, normals: Floats, u: Floats, found: Floats
) -> None:
    """Fill ``found`` (q, channels) with the sum of second derivatives along tangents: the trace of P H P.

    ``points`` (q, d) in the patches ``patch`` (q,), where ``normals`` (q, c, d) are normal to the manifold.
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


#: Marked patches hold this share of the sum of squares.
MARKED_SHARE = 0.5
#: The diffusivity's slope is a difference over this share of the spacing.
SLOPE_STEP_SHARE = 1e-3
#: With local errors that fall like this power of the size of patches, by what is gained by sizes that differ.
ORDER = 3.0


def residual_squares(form: RefinedGalerkin, u: Floats) -> Floats:
    """Return (p,) the squares of the residual of ``u`` (n, channels), over patches, in units of h_l^-2.

    Channels count as shares of their own sum, so that the unit of none outweighs another.
    """
    found = _residual(form, u) ** 2
    sums = form.point_weights @ found
    shares = found @ (1 / np.where(sums > 0, sums, 1.0)) * form.point_weights
    patch = form.refined.dof_map.patch[: len(shares)]
    patches = len(form.refined.dof_map.cells)
    lengths = 0.5**form.refined.dof_map.levels
    return np.bincount(patch, shares, minlength=patches) * lengths**4


def _residual(form: RefinedGalerkin, u: Floats) -> Floats:
    """Return (p, channels) ``f + a Lap u + grad a . grad u - c u`` at the samples of the manifold."""
    terms, points = form.scene.problem.terms(), form.points
    channels = u.shape[1]
    f = evaluate_data(terms.f, points, channels, "the right-hand side f")
    c = evaluate_data(terms.c, points, 1, "the factor c")
    a = evaluate_data(terms.diffusivity, points, 1, "the diffusivity")
    found = f + a * _laplacian(form, u) - c * form.at_points(u)
    if callable(terms.diffusivity):
        slope = np.stack([_slope(terms.diffusivity, points, form.spacing, axis) for axis in range(points.shape[1])], 1)
        found += np.einsum("pd,pcd->pc", slope, form.slopes_at_points(u))
    return np.asarray(found)


def _slope(a: Any, points: Floats, spacing: float, axis: int) -> Floats:
    step = SLOPE_STEP_SHARE * spacing * np.eye(points.shape[1])[axis]
    ahead, behind = (evaluate_data(a, points + sign * step, 1, "the diffusivity")[:, 0] for sign in (1, -1))
    return np.asarray((ahead - behind) / (2 * SLOPE_STEP_SHARE * spacing))


def _laplacian(form: RefinedGalerkin, u: Floats) -> Floats:

    dof_map, samples = form.refined.dof_map, form.sampled.samples
    spread, found = np.ascontiguousarray(form.representation @ u), np.empty((form.sampled.interior, u.shape[1]))
    for start in range(0, len(found), SAMPLES_AT_ONCE):
        some = slice(start, min(start + SAMPLES_AT_ONCE, len(found)))
        patch = dof_map.patch[some]
        at = np.ascontiguousarray(dof_map.magnified(patch, samples.points_at(some)))
        normals, own = np.ascontiguousarray(samples.normals_at(some)), np.empty((len(patch), u.shape[1]))
        second_derivatives(dof_map.unknowns, dof_map.cells, dof_map.spacing, patch, at, normals, spread, own)
        found[some] = own * dof_map.scales(patch)[:, None] ** 2
    return found


def mark_patches(found: Floats) -> Bools:
    """Return (p,) the patches that hold half of the ``found`` squares (p,), the largest first (Doerfler)."""
    order = np.argsort(-found, kind="stable")
    total = np.cumsum(found[order])
    chosen = np.zeros(len(found), dtype=bool)
    if total[-1] > 0:
        chosen[order[: int(np.searchsorted(total, MARKED_SHARE * total[-1])) + 1]] = True
    return chosen


def expected_gain(form: RefinedGalerkin, found: Floats) -> float:
    """Return by how many times fewer unknowns sizes of patches that differ would leave the same error.

    With squares e_p of patches of areas w_p at size h that fall like h^(2 k), unknowns like h^-2, the fewest unknowns
    for one sum of squares are those at sizes h_p^2 in proportion to (w_p / e_p)^(1 / (k + 1)): the gain is
    ``(sum w)(sum e)^(1/k) / (sum w^(k/(k+1)) e^(1/(k+1)))^((k+1)/k)``.
    """
    dof_map, k = form.refined.dof_map, ORDER
    patches = len(dof_map.cells)
    area = np.bincount(dof_map.patch, form.sampled.samples.weights, minlength=patches)
    if not found.sum() > 0:
        return 1.0
    best = np.sum(area ** (k / (k + 1)) * found ** (1 / (k + 1))) ** ((k + 1) / k)
    return float(area.sum() * found.sum() ** (1 / k) / best)
