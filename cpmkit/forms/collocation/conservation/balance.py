"""The mean of u on closed pieces: how far the operators miss conservation, and its correction.

Integrated over a closed surface, or one between walls, -div(a grad u) vanishes, so c times the mean of u is the mean
of f. The operators of the closest point method do not conserve: on meshes with creases and thin parts a small flux is
lost or gained, and where c is small the mean of u is off by that flux over c.
"""

from __future__ import annotations

import numpy as np

from cpmkit.forms.collocation.conservation.components import components_without_flux
from cpmkit.forms.collocation.conservation.free_constants import means_over, place_of
from cpmkit.forms.collocation.discretization import Discretization
from cpmkit.forms.free_constants import Imbalance
from cpmkit.protocols import Floats
from cpmkit.scene.scene import Scene

#: The mean is corrected where c times the square of the surface's size is below this: there a flux that is lost
#: anywhere shifts u by a constant.
SMALL_REACTION = 10.0
#: A u that varies by less than this share of its size counts as constant: a mean is not reported as wrong because of
#: rounding.
CONSTANT_RANGE_SHARE = 1e-6
#: A mean that was wrong by more than this share of the range of u is reported.
TOLD_MEAN_SHARE = 1e-2


def correct_means(tables: Discretization, scene: Scene, b: Floats, u: Floats) -> tuple[Floats, tuple[Imbalance, ...]]:
    """Return u (n, channels) shifted on each piece that nothing flows out of, and by how much its mean was off there.

    Nothing is done where c varies or is zero, where a velocity carries u along, and where c is so large that a leak
    shows near its place and not as a constant; nor for small leaks of a piece with edges, where means are less exact,
    or for any of it at order 1, where they are off by as much as u.
    """
    terms, layout = scene.problem.terms(), tables.layout
    if callable(terms.c) or terms.c <= 0 or terms.velocity is not None:
        return u, ()
    size = float(np.ptp(layout.band.feet.points, axis=0).max())
    if terms.c * size**2 > SMALL_REACTION:
        return u, ()
    count, piece = components_without_flux(tables, scene)
    if not count:
        return u, ()
    mean, members, piece = means_over(tables, count, piece)
    imbalance = terms.c * (mean @ u) - mean @ b  # without conditions it is f
    open_pieces = np.unique(piece[layout.band.feet.edge[members] >= 0])
    shift, found = np.zeros_like(imbalance), []
    for k in range(count):
        on = members[piece == k]
        one = Imbalance(
            "mean",
            value=tuple(imbalance[k].tolist()),
            size=tuple((terms.c * span_of(u[on])).tolist()),
            explained=TOLD_MEAN_SHARE,
            **place_of(tables, scene, on),
            shift=tuple((-imbalance[k] / terms.c).tolist()),
        )
        if k in open_pieces and (one.relative <= TOLD_MEAN_SHARE or layout.order == 1):
            continue
        shift[k] = one.shift
        found.append(one)
    u = u.copy()
    u[members] += shift[piece]
    return u, tuple(found)


def span_of(u: Floats) -> Floats:
    """Return the range (channels,) of u (n, channels); for a constant u, a bound of its rounding error."""
    span: Floats = np.maximum(np.ptp(u, axis=0), CONSTANT_RANGE_SHARE * np.abs(u).max(axis=0))
    return span
