"""Why the error of a scene on a lattice may fall more slowly than elsewhere: what its estimate has to allow for."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cpmkit.forms.galerkin.telling import TURNED_SHARE
from cpmkit.manifold.local_source import largest_dim
from cpmkit.scene.state_diffusivity import StateDiffusivity

if TYPE_CHECKING:
    from cpmkit.forms.galerkin.form import Galerkin

#: Folds whose splines are more than this over the root of all splines: so they are where folds are about as long as the
#: manifold is wide, at any spacing, though their share of it falls. Nefertiti .7 to 1.6, and estimates without this a
#: third of the error; Spot, koala and fish where they are resolved, a cube and a Moebius strip below .8.
FOLD_ROOTS = 0.85
#: A layer narrower than this, in spacings, is not resolved: estimates were down to .3 of the error at a half, .66 at 1.
LAYER_SPACINGS = 0.9


def why_slow(form: Galerkin) -> str:
    """Return in words why the error may fall slowly; nothing where nothing says so."""
    mesh, turned = form.sampled.mesh, form.turned
    if bool(mesh.extends.any()) and not form.sampled.singular:
        return "boundaries end inside the surface; the error may fall slowly"
    if turned.share > TURNED_SHARE:
        return f"thin, folded or creased: {turned.share:.0%} of the area; the error may fall slowly"
    if largest_dim(form.scene.surface) == 2 and turned.share * np.sqrt(form.size) > FOLD_ROOTS:
        return f"long folds or creases, with {turned.share:.1%} of the area; the error may fall slowly"
    width = layer_spacings(form)
    if width < LAYER_SPACINGS:
        return f"a layer beside conditions is {width:.2g} spacings wide; the error may fall slowly"
    return ""


def layer_spacings(form: Galerkin) -> float:
    """Return the width sqrt(a / c) of layers beside conditions in spacings; infinite where there can be none.

    In steady problems -div(a grad u) + c u = f, where a condition holds anything but zero flux.
    """
    terms = form.scene.problem.terms()
    if form.scene.problem.family != "steady" or not any(not one.seam for one in form.sampled.held):
        return np.inf
    if form.scene.has_tensor or isinstance(terms.diffusivity, StateDiffusivity):
        return np.inf
    c = float(form.read(terms.c, "the factor c").max())
    if c <= 0:
        return np.inf
    a = float(form.read(terms.diffusivity, "the diffusivity").min())
    return float(np.sqrt(a / c) / form.spacing)
