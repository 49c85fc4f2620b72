"""Why the error of a scene on a lattice may fall more slowly than elsewhere: what its estimate has to allow for."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from cpmkit.forms.galerkin.mesh_warnings import TURNED_SHARE
from cpmkit.manifold.local_source import LocalSource
from cpmkit.mesh.normals_of_mesh import SUPPORTED, UNSUPPORTED
from cpmkit.meshing.curved_from_normals import source_support
from cpmkit.meshing.mesh_cache import mesh_cache_of
from cpmkit.scene.diffusivities import StateDiffusivity, evaluate_diffusivity, principal_values
from cpmkit.types import Floats

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


def slow_convergence_reason(form: Galerkin, coarser: Discretized | None = None) -> str:
    """Return in words why the error may fall slowly, beside a coarser lattice too if one is given; else nothing."""
    return end_or_layer_reason(form) or _fold_reason(form, coarser)


def _fold_reason(form: Galerkin, coarser: Discretized | None) -> str:
    share = form.turned.share
    if share > TURNED_SHARE:
        return f"thin, folded or creased: {share:.0%} of the area; the error may fall slowly"
    if coarser is not None and folds_persist(form, coarser):
        same = f"about as much at spacing {coarser.spacing:.3g}"
        return f"thin, folded or creased: {share:.1%} of the area, {same}; the error may fall slowly"
    return ""


def end_or_layer_reason(form: Galerkin) -> str:
    """Return whether boundaries end inside the surface, or a layer beside conditions is not resolved, in words."""
    if bool(form.sampled.mesh.beyond_tip.any()) and not form.sampled.singular:
        return "boundaries end inside the surface; the error may fall slowly"
    if form.layer_spacings < LAYER_SPACINGS:
        where = "along the direction that conducts worst" if form.scene.has_tensor else "beside conditions"
        return f"a layer {where} is {form.layer_spacings:.2g} spacings wide; the error may fall slowly"
    return ""


def folds_persist(form: Galerkin, coarser: Discretized) -> bool:
    """Return whether the manifold turns under splines of a coarser lattice on hardly more of its area."""
    mine, theirs = form.turned.share, folded_share(coarser)
    halvings = np.log2(coarser.spacing / form.spacing)
    return bool(mine > STAYING_AREA and mine > STAYING_SHARE**halvings * theirs)


def folded_share(form: Discretized) -> float:
    """Return the share of the area on splines under which the manifold turns; 0 of a form that does not know it."""
    turned = getattr(form, "turned", None)
    return 0.0 if turned is None else float(turned.share)


def curved_share(form: Discretized) -> float:
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
    c = float(form.data_at_points(terms.c, "the factor c").max())
    if form.scene.has_tensor:
        return _tensor_layer(form, c) / form.spacing
    if c <= 0 or not any(not one.seam for one in form.sampled.held):
        return np.inf
    a = float(form.data_at_points(terms.diffusivity, "the diffusivity").min())
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


#: Of the difference between the lifted surface and its triangles, a share of at least so much is in doubt; three times
#: the share of the area with edges that are not fully supported; and so many times that where more than
#: ``PILLOW_SHARE`` is not supported at all. Over true errors of 23 meshes: .8 to 22.
LEAST_DOUBT, DOUBT_PER_SHARE, PILLOW_FACTOR, PILLOW_SHARE = 0.1, 3.0, 2.5, 0.05


def support_floor(surface: LocalSource, area: float, apart: float | None) -> float:
    """Return the error that the lift of a mesh leaves in solutions, as a share of their range.

    0 where cells are not those of meshes.

    Parameters
    ----------
    surface : LocalSource
        The manifold, a mesh that is read as smooth, or a union of such.
    area : float
        Of the lifted surface.
    apart : float, optional
        By how much a solution on the lifted surface differs from one on the triangles, root mean square; the relative
        difference of their areas, which is as a rule larger, unless it is given.
    """
    parts = [_areas_by_support(member) for member in surface.members]
    found = np.array([part for part in parts if part is not None])
    if len(found) < len(parts):
        return 0.0
    flat, unsupported, doubtful = found.sum(axis=0)
    difference = abs(area / flat - 1) if apart is None else apart
    doubt = max(LEAST_DOUBT, min(1.0, DOUBT_PER_SHARE * doubtful / flat))
    return float(min(1.0, difference * doubt * (PILLOW_FACTOR if unsupported > PILLOW_SHARE * flat else 1.0)))


def _areas_by_support(surface: LocalSource) -> Floats | None:
    """Return the area of a source's own triangles, of those with an unsupported edge, and with one in doubt."""
    own, support = mesh_cache_of(surface), source_support(surface)
    if own is None or support is None:
        return None
    corners = own.mesh.vertices[own.mesh.cells]
    areas = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    beside = [support.unsupported(limit)[own.mesh.edges.of_cells].any(axis=1) for limit in (UNSUPPORTED, SUPPORTED)]
    return np.array([areas.sum(), *(areas[rows].sum() for rows in beside)])
