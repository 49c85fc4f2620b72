"""Twins for what stencils want: at further feet of the nodes, or where the surface is unfolded onto them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cpmkit.forms.collocation.sheets.sheets import CLOSE, NEAR, has_signed_normals, same_sheet
from cpmkit.forms.collocation.sheets.sites import Sites, Wanted
from cpmkit.grid.band import Band
from cpmkit.manifold.localized import Localized
from cpmkit.manifold.tangent_space import normals
from cpmkit.manifold.walking import feet_from
from cpmkit.protocols import Bools, ClosestPoints, Ints

#: At most so many twins a node gets in one round: sheets it lies between, and places that it is unfolded to.
AT_ONCE, UNFOLDED_AT_ONCE = 4, 12
#: A foot nearer to the node's own than this many spacings is the same.
SAME = 0.1


def add_feet(source: Localized, band: Band, sites: Sites, wanted: Wanted) -> Sites:
    """Return the sites with twins where a node has a foot on the sheet it is wanted on; one serves all on its sheet."""
    left = wanted
    for _ in range(AT_ONCE):
        if not len(left.nodes):
            break
        first = np.unique(left.nodes, return_index=True)[1]
        count = len(sites)
        sites = _with_feet(source, band, sites, left.take(first))
        again = np.ones(len(left.nodes), dtype=bool)
        again[first] = False
        if len(sites) > count:
            again &= ~_served(source, band, sites, count, left)
        left = left.take(again)
    return sites


def _with_feet(source: Localized, band: Band, sites: Sites, wanted: Wanted) -> Sites:
    """Return the sites with twins at feet that are on the sheets of the sites that want them, where there are any.

    Of the feet that a node has, the nearest on the sheet is taken.
    """
    nodes, by = wanted.nodes, wanted.by
    rows, feet = feet_from(source, band.positions[nodes], sites.feet.take(by), band.spacing)
    y, n = feet.points, normals(source, feet, 0.5 * band.spacing)
    signed = has_signed_normals(source)
    own = same_sheet(sites.feet.points[by[rows]], sites.normals[by[rows]], y, n, band.spacing, signed)
    own &= np.linalg.norm(y - sites.feet.points[nodes[rows]], axis=1) > SAME * band.spacing
    chosen = np.flatnonzero(own)
    chosen = chosen[np.unique(rows[chosen], return_index=True)[1]]
    nodes, unknown = nodes[rows[chosen]], wanted.unknown[rows[chosen]]
    return sites.grown(nodes, _standing(band, nodes, feet.take(chosen)), n[chosen], unknown, None)


def _served(source: Localized, band: Band, sites: Sites, count: int, wanted: Wanted) -> Bools:
    """Tell which of the wants the new twins, sites from ``count`` on and at most one a node, fulfil."""
    new, by = np.arange(count, len(sites)), wanted.by
    twin = new[np.minimum(np.searchsorted(sites.base[new], wanted.nodes), len(new) - 1)]
    served = (sites.base[twin] == wanted.nodes) & (sites.unknown[twin] | ~wanted.unknown)
    here, there = (sites.feet.points[by], sites.normals[by]), (sites.feet.points[twin], sites.normals[twin])
    return np.asarray(served & same_sheet(*here, *there, band.spacing, has_signed_normals(source)))


def add_unfolded(source: Localized, band: Band, sites: Sites, wanted: Wanted) -> Sites:
    """Return the sites with twins at unfolded feet; one serves all that are near it.

    A way that ends at the surface's edge is none: past it the edge's own condition holds.
    """
    left = wanted.take(wanted.feet.edge < 0)
    for _ in range(UNFOLDED_AT_ONCE):
        if not len(left.nodes):
            break
        nodes, first, place = np.unique(left.nodes, return_index=True, return_inverse=True)
        new = left.take(first)
        feet = _standing(band, nodes, new.feet)
        sites = sites.grown(nodes, feet, normals(source, feet, 0.5 * band.spacing), new.unknown, new.by)
        away = np.linalg.norm(left.feet.points - feet.points[place], axis=1)
        served = away <= np.where(left.unknown, NEAR, CLOSE) * band.spacing
        served &= new.unknown[place] | ~left.unknown
        served[first] = True
        left = left.take(~served)
    return sites


def _standing(band: Band, nodes: Ints, feet: ClosestPoints) -> ClosestPoints:
    """Return feet with their distances from the nodes that stand on them."""
    return replace(feet, distance=np.linalg.norm(band.positions[nodes] - feet.points, axis=1))
