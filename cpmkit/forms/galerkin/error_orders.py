"""The order with which differences of two solutions estimate errors (GALERKIN 10), and the dispersion of splines."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from cpmkit.forms.form_records import Dispersion
from cpmkit.forms.galerkin.resolution import PERSISTING_AREA, Resolution
from cpmkit.forms.galerkin.solution_warnings import FOLDED_SHARE

#: Divisors of the difference from a solution at twice the spacing, and the corresponding divisors at the root of two
#: times the spacing.
FROM_TWO, FROM_ROOT = (0.65, 1.0, 2.5, 6.0, 12.0), (0.42, 0.59, 1.25, 1.8, 2.8)
#: Divisors by degree where cells follow a smooth source: at orders 3 and 4 differences are 7 and 15 times the error.
#: For eigenvalues, at order 4, 15 times (measured: 13 to 17).
ERROR_DIVISORS = {1: 2.4, 2: 6.0, 3: 12.0}
EIGENVALUE_DIVISORS = {1: 2.4, 2: 12.0, 3: 12.0}
#: Largest divisors: on meshes, where orders are lower; on smooth sources that are folded on the coarser lattice, or
#: curved about as sharply as the finer spacing on more than this share of their area, or with a layer narrower than so
#: many spacings; where boundaries end, or a layer is not resolved.
MESH_DIVISOR, TURNING_DIVISOR, CURVED_AREA, SEEN_LAYER_SPACINGS, END_DIVISOR = 2.5, 2.0, 1e-4, 1.6, 0.65
#: On smooth sources that are curved so sharply on the coarser lattice alone: along an edge whose radius is between both
#: spacings the largest error hardly falls (of a body with one it was three times the estimate with 6; a torus: 8).
BENDING_DIVISOR = 3.0
#: On meshes that are folded on the coarser lattice, or on the finer one on more than a small share, and where folds
#: persist; on smooth sources whose folds persist on more than this share of the area.
FOLDED_DIVISOR, PERSISTING_DIVISOR, THIN_DIVISOR, THIN_SHARE = 1.25, 0.65, 1.0, 0.1
#: Factors of divisors by the difference of the solutions as a share of the range: errors with larger differences are
#: not yet in the asymptotic range (of 370 on smooth surfaces, 5 in 100 had true divisors of degree 2 below 5.8 up to
#: 3e-4, below 3 up to 3e-3, below 1.6 beyond).
DIFFERENCES, FACTORS_OF_DIFFERENCE = (3e-4, 3e-3, 2e-2), (7 / 6, 4 / 6, 0.45)
#: Factors by the coarser spacing as a share of the manifold's largest side (medians of divisors: 8.3 below .13, 7.3 at
#: .18, 6.4 at .23, 4.5 at .27, 3.4 at .33).
SPACING_SHARES, FACTORS_OF_SPACING = (0.17, 0.32), (7 / 6, 1 / 2)


def difference_order(
    resolution: Resolution, smooth: float, ratio: float, coarser: Resolution | None, difference: float
) -> float:
    """Return the order p with which ``|u_h - u_rh| / (r^p - 1)`` estimates the error, at a ratio r of spacings.

    Parameters
    ----------
    resolution : Resolution
        The resolution of the finer lattice.
    smooth : float
        The divisor at twice the spacing where cells follow a smooth source.
    ratio, coarser, difference
        See :meth:`cpmkit.forms.contract.Discretized.diagnosis`.
    """
    return order_of_divisor(_divisor(resolution, smooth, coarser, difference), ratio)


def order_of_divisor(divisor: float, ratio: float) -> float:
    """Return the order p with ``r^p - 1`` equal to the ``divisor`` at r = 2, and to `FROM_ROOT` at the root of two.

    The order is interpolated in the logarithm of r = ``ratio`` between these two, and constant beyond.
    """
    at_root = math.log(1 + float(np.interp(divisor, FROM_TWO, FROM_ROOT))) / math.log(math.sqrt(2))
    at_two = math.log2(1 + divisor)
    share = min(max(2 * math.log2(ratio) - 1, 0.0), 1.0)
    return at_root + share * (at_two - at_root)


def _divisor(resolution: Resolution, smooth: float, coarser: Resolution | None, difference: float) -> float:
    """Return the number by which a difference from a solution at twice the spacing is divided to estimate the error."""
    if resolution.end_or_layer_reason():
        return END_DIVISOR
    spread = resolution.normal_spread
    coarser_share = 0.0 if coarser is None else coarser.normal_spread.unresolved_share
    persists = spread.unresolved_share > FOLDED_SHARE if coarser is None else resolution.folds_persist(coarser)
    if resolution.sampled.geometry != "closest_point":
        folded = spread.unresolved_share > PERSISTING_AREA or coarser_share > FOLDED_SHARE
        return PERSISTING_DIVISOR if persists else min(smooth, FOLDED_DIVISOR if folded else MESH_DIVISOR)
    if persists and spread.unresolved_share > THIN_SHARE:
        return THIN_DIVISOR
    if (
        spread.bending_share > CURVED_AREA
        or coarser_share > FOLDED_SHARE
        or resolution.layer_spacings < SEEN_LAYER_SPACINGS
    ):
        return min(smooth, TURNING_DIVISOR)
    if coarser is not None and coarser.normal_spread.bending_share > CURVED_AREA:
        return min(smooth, BENDING_DIVISOR)
    factor = float(np.interp(math.log(max(difference, DIFFERENCES[0])), np.log(DIFFERENCES), FACTORS_OF_DIFFERENCE))
    return smooth * min(factor, 1.0 if coarser is None else _factor_of_spacing(coarser))


def _factor_of_spacing(coarser: Resolution) -> float:
    """Return the factor of the divisor for the coarser spacing as a share of the manifold's largest side."""
    side = float(np.ptp(np.asarray(coarser.scene.surface.bounds), axis=0).max())
    return float(np.interp(coarser.spacing / side, SPACING_SHARES, FACTORS_OF_SPACING))


#: By degree. Of quadratic splines (3.5 nodes a wavelength and 2.9) the first 144 eigenvalues of a sphere at h = .2 and
#: .25 have errors of .0007 to .0018 (k h)^4; of linear splines .031 to .041 (k h)^2; of cubic ones .0005 to .001
#: (k h)^4 beyond the first few, which are affected by the curvature of the sphere at spacings as coarse as these.
DISPERSION_OF_DEGREE = {
    1: Dispersion(resolved=0.55, coarsest=0.75, power=2, waves=0.035, bends=0.02),
    2: Dispersion(resolved=1.8, coarsest=2.2, power=4, waves=0.002, bends=0.02),
    3: Dispersion(resolved=1.9, coarsest=2.2, power=4, waves=0.001, bends=0.02),
}


def on_curved_cells(splines: Dispersion) -> Dispersion:
    """Return the dispersion of splines whose cells follow a smooth source.

    The first eigenvalues of the circle at h = .05 and of the sphere at .2 have .5 to 1.5 times these errors; with the
    square of h / radius the predicted errors would be a hundred times as large.
    """
    return replace(splines, bend_power=splines.power)
