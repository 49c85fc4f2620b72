"""Why the error of a scene on a lattice may fall more slowly than elsewhere: what its estimate has to allow for."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from cpmkit.forms.galerkin.telling import TURNED_SHARE
from cpmkit.scene.diffusivities import StateDiffusivity, evaluate_diffusivity, principal_values

if TYPE_CHECKING:
    from cpmkit.forms.contract import Discretized
    from cpmkit.forms.galerkin.form import Galerkin

#: Folds stay where more than the first share of the area is on splines under which the manifold turns, and more than
#: the second of what it was at twice the spacing: where parts are thinner than both, both have the same errors there
#: (Nefertiti .5 to 1.9, and estimates without this are a quarter of the error; Spot, koala and fish .1 to .4 from the
#: second solution on, and estimates without this are right).
STAYING_AREA, STAYING_SHARE = 0.005, 0.4
#: A layer narrower than this, in spacings, is not resolved: estimates were down to .3 of the error at a half, .66 at 1.
LAYER_SPACINGS = 0.9


def why_slow(form: Galerkin, coarser: Discretized | None = None) -> str:
    """Return in words why the error may fall slowly, beside a coarser lattice too if one is given; else nothing."""
    return end_or_layer(form) or _folded(form, coarser)


def _folded(form: Galerkin, coarser: Discretized | None) -> str:
    share = form.turned.share
    if share > TURNED_SHARE:
        return f"thin, folded or creased: {share:.0%} of the area; the error may fall slowly"
    if coarser is not None and folds_stay(form, coarser):
        same = f"about as much at spacing {coarser.spacing:.3g}"
        return f"thin, folded or creased: {share:.1%} of the area, {same}; the error may fall slowly"
    return ""


def end_or_layer(form: Galerkin) -> str:
    """Return whether boundaries end inside the surface, or a layer beside conditions is not resolved, in words."""
    if bool(form.sampled.mesh.extends.any()) and not form.sampled.singular:
        return "boundaries end inside the surface; the error may fall slowly"
    if form.layer_spacings < LAYER_SPACINGS:
        where = "along the direction that conducts worst" if form.scene.has_tensor else "beside conditions"
        return f"a layer {where} is {form.layer_spacings:.2g} spacings wide; the error may fall slowly"
    return ""


def folds_stay(form: Galerkin, coarser: Discretized) -> bool:
    """Return whether the manifold turns under splines of a coarser lattice on hardly more of its area."""
    mine, theirs = form.turned.share, turned_share(coarser)
    halvings = np.log2(coarser.spacing / form.spacing)
    return bool(mine > STAYING_AREA and mine > STAYING_SHARE**halvings * theirs)


def turned_share(form: Discretized) -> float:
    """Return the share of the area on splines under which the manifold turns; 0 of a form that does not know it."""
    turned = getattr(form, "turned", None)
    return 0.0 if turned is None else float(turned.share)


def bent_share(form: Discretized) -> float:
    """Return the share of the area on splines under which the manifold bends about as sharply as the spacing."""
    turned = getattr(form, "turned", None)
    return 0.0 if turned is None else float(turned.bent)


def layer_spacings(form: Galerkin) -> float:
    """Return the width of layers in spacings; infinite where there can be none.

    In steady problems -div(a grad u) + c u = f they are sqrt(a / c) wide, beside conditions that hold anything but zero
    flux. A tensor that conducts badly along one direction has them anywhere, sqrt(a / c) wide with its smallest
    eigenvalue on tangents, and no wider than the manifold times the root of the smallest over the largest.
    """
    terms = form.scene.problem.terms()
    if form.scene.problem.family != "steady" or isinstance(terms.diffusivity, StateDiffusivity):
        return np.inf
    c = float(form.read(terms.c, "the factor c").max())
    if form.scene.has_tensor:
        return _tensor_layer(form, c) / form.spacing
    if c <= 0 or not any(not one.seam for one in form.sampled.held):
        return np.inf
    a = float(form.read(terms.diffusivity, "the diffusivity").min())
    return float(np.sqrt(a / c) / form.spacing)


def tensor_layer_warnings(form: Galerkin) -> Iterator[str]:
    """Return a sentence where a tensor conducts so badly along one direction that the spacing resolves no layer."""
    if form.scene.problem.family == "steady" and form.scene.has_tensor and form.layer_spacings < LAYER_SPACINGS:
        yield (
            "The diffusivity conducts so badly along one direction that the solution may have layers "
            f"{form.layer_spacings:.2g} spacings wide, which are not resolved; a spacing of "
            f"{form.spacing * form.layer_spacings / LAYER_SPACINGS:.2g} or less resolves them."
        )


def _tensor_layer(form: Galerkin, c: float) -> float:
    tensors = evaluate_diffusivity(form.scene.problem.terms().diffusivity, form.points, "the diffusivity")
    normals = form.sampled.samples.normals_at(slice(form.sampled.interior))
    least, largest = principal_values(tensors, normals)
    radius = 0.5 * float(np.ptp(np.asarray(form.scene.surface.bounds), axis=0).max())
    least = np.maximum(least, 0.0)  # a tensor with a negative eigenvalue is refused where it is summed
    width = radius * np.sqrt((least / largest).min())
    return float(width if c <= 0 else min(width, np.sqrt(least.min() / c)))
