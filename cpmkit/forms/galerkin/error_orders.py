"""At which order errors are taken to fall: what differences of two solutions are divided by (GALERKIN 10)."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from cpmkit.forms.form_records import Dispersion
from cpmkit.forms.galerkin.mesh_warnings import TURNED_SHARE
from cpmkit.forms.galerkin.slow_convergence import (
    STAYING_AREA,
    curved_share,
    end_or_layer_reason,
    folded_share,
    folds_persist,
)

if TYPE_CHECKING:
    from cpmkit.forms.contract import Discretized
    from cpmkit.forms.galerkin.form import Galerkin

#: Divisors of differences from twice the spacing, and those from the root of two that go with them.
FROM_TWO, FROM_ROOT = (0.65, 1.0, 2.5, 6.0, 12.0), (0.42, 0.59, 1.25, 1.8, 2.8)
#: Where cells follow a smooth source, by degree: at orders 3 and 4 differences are 7 and 15 times the error. Of
#: eigenvalues, at order 4, 15 times (measured: 13 to 17).
ERROR_DIVISORS = {1: 2.4, 2: 6.0, 3: 12.0}
EIGENVALUE_DIVISORS = {1: 2.4, 2: 12.0, 3: 12.0}
#: At most: on meshes, where orders are lower; of smooth sources that turn under splines of the coarser lattice, or bend
#: under those of the finer one on more than this share of their area, or with a layer narrower than so many spacings;
#: where boundaries end, or a layer is not resolved.
MESH_DIVISOR, TURNING_DIVISOR, CURVED_AREA, SEEN_LAYER_SPACINGS, END_DIVISOR = 2.5, 2.0, 1e-4, 1.6, 0.65
#: Of smooth sources that bend so under splines of the coarser lattice alone: along an edge whose radius is between both
#: spacings the largest error hardly falls (of a body with one it was three times the estimate with 6; a torus: 8).
BENDING_DIVISOR = 3.0
#: Of meshes that turn under splines of the coarser lattice, or of the finer one on more than a small share, and where
#: folds stay; of smooth sources on the latter if more than this share of the area is turned.
FOLDED_DIVISOR, STAYING_DIVISOR, THIN_DIVISOR, THIN_SHARE = 1.25, 0.65, 1.0, 0.1
#: Divisors are so many times as large where solutions are that far apart, as shares of the range, for errors of larger
#: differences do not yet fall as they should (of 370 on smooth surfaces, 5 in 100 had true divisors of degree 2 below
#: 5.8 up to 3e-4, below 3 up to 3e-3, below 1.6 beyond).
APART, FACTORS_APART = (3e-4, 3e-3, 2e-2), (7 / 6, 4 / 6, 0.45)
#: The same of coarser spacings as shares of the manifold's largest side (medians of these: 8.3 below .13, 7.3 at .18,
#: 6.4 at .23, 4.5 at .27, 3.4 at .33).
COARSE, FACTORS_COARSE = (0.17, 0.32), (7 / 6, 1 / 2)


def difference_order(form: Galerkin, smooth: float, ratio: float, coarser: Discretized | None, apart: float) -> float:
    """Return the order p with which ``|u_h - u_rh| / (r^p - 1)`` estimates the error, at a ratio r of spacings.

    Parameters
    ----------
    form : Galerkin
        Of the finer solution.
    smooth : float
        The divisor where cells follow a smooth source, and the ratio is two.
    ratio, coarser, apart
        See :meth:`cpmkit.forms.contract.Discretized.diagnosis`.
    """
    return order_of_divisor(_divisor(form, smooth, coarser, apart), ratio)


def order_of_divisor(divisor: float, ratio: float) -> float:
    """Return the order p with ``r^p - 1`` equal to the divisor at r = 2, to what goes with it at the root of two.

    Between them it is in between, below and above that of the nearer one.
    """
    near = math.log(1 + float(np.interp(divisor, FROM_TWO, FROM_ROOT))) / math.log(math.sqrt(2))
    far = math.log2(1 + divisor)
    share = min(max(2 * math.log2(ratio) - 1, 0.0), 1.0)
    return near + share * (far - near)


def _divisor(form: Galerkin, smooth: float, coarser: Discretized | None, apart: float) -> float:
    if end_or_layer_reason(form):
        return END_DIVISOR
    mine, theirs = form.turned.share, 0.0 if coarser is None else folded_share(coarser)
    stays = mine > TURNED_SHARE if coarser is None else folds_persist(form, coarser)
    if form.sampled.geometry != "closest_point":
        folded = mine > STAYING_AREA or theirs > TURNED_SHARE
        return STAYING_DIVISOR if stays else min(smooth, FOLDED_DIVISOR if folded else MESH_DIVISOR)
    if stays and mine > THIN_SHARE:
        return THIN_DIVISOR
    if form.turned.bent > CURVED_AREA or theirs > TURNED_SHARE or form.layer_spacings < SEEN_LAYER_SPACINGS:
        return min(smooth, TURNING_DIVISOR)
    if coarser is not None and curved_share(coarser) > CURVED_AREA:
        return min(smooth, BENDING_DIVISOR)
    return smooth * min(_factor_of_difference(apart), 1.0 if coarser is None else _factor_of_spacing(coarser))


def _factor_of_difference(apart: float) -> float:
    return float(np.interp(math.log(max(apart, APART[0])), np.log(APART), FACTORS_APART))


def _factor_of_spacing(coarser: Discretized) -> float:
    side = float(np.ptp(np.asarray(coarser.scene.surface.bounds), axis=0).max())
    return float(np.interp(coarser.spacing / side, COARSE, FACTORS_COARSE))


#: By degree. Of quadratic splines (3.5 nodes a wavelength and 2.9) the first 144 eigenvalues of a sphere at h = .2 and
#: .25 have errors of .0007 to .0018 (k h)^4; of linear splines .031 to .041 (k h)^2; of cubic ones .0005 to .001
#: (k h)^4 beyond the first few, which are affected by the curvature of the sphere at spacings as coarse as these.
DISPERSION_OF_DEGREE = {
    1: Dispersion(resolved=0.55, coarsest=0.75, power=2, waves=0.035, bends=0.02),
    2: Dispersion(resolved=1.8, coarsest=2.2, power=4, waves=0.002, bends=0.02),
    3: Dispersion(resolved=1.9, coarsest=2.2, power=4, waves=0.001, bends=0.02),
}


def on_curved_cells(splines: Dispersion) -> Dispersion:
    """Return how well splines carry waves where their cells follow a smooth source.

    The first eigenvalues of the circle at h = .05 and of the sphere at .2 have .5 to 1.5 times these errors; with the
    square of h / radius a hundred times as much had been told.
    """
    return replace(splines, bend_power=splines.power)
