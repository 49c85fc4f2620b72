"""New twins for missing sites, at further feet of the nodes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cpmkit.forms.collocation.sheets.sheets import (
    has_signed_normals,
    same_sheet,
)
from cpmkit.forms.collocation.sheets.sites import MissingSites, Sites
from cpmkit.grid.band import Band
from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.tangent_space import unit_normals
from cpmkit.manifold.walking import feet_from
from cpmkit.protocols import Bools, ClosestPoints, Ints

#: Most twins that a node gets in one round: one for each sheet that it lies between.
TWINS_PER_ROUND = 4
#: Two feet of a node nearer than so many spacings are the same.
SAME_FOOT_SPACINGS = 0.1


def add_twins_at_feet(source: LocalSource, band: Band, sites: Sites, missing: MissingSites) -> Sites:
    """Return the sites with twins at nodes that have a foot on the missing sheet; one twin serves a whole sheet."""
    unserved = missing
    for _ in range(TWINS_PER_ROUND):
        if not len(unserved.nodes):
            break
        first = np.unique(unserved.nodes, return_index=True)[1]
        count = len(sites)
        sites = _with_twins_at_feet(source, band, sites, unserved.take(first))
        again = np.ones(len(unserved.nodes), dtype=bool)
        again[first] = False
        if len(sites) > count:
            again &= ~_is_served(source, band, sites, count, unserved)
        unserved = unserved.take(again)
    return sites


def _with_twins_at_feet(source: LocalSource, band: Band, sites: Sites, missing: MissingSites) -> Sites:
    """Return the sites with twins at feet that are on the sheets of the sites that want them, where there are any.

    Of the feet that a node has, the nearest on the sheet is taken.
    """
    nodes, by = missing.nodes, missing.by
    rows, feet = feet_from(source, band.positions[nodes], sites.feet.take(by), band.spacing)
    y, n = feet.points, unit_normals(source, feet, 0.5 * band.spacing)
    signed = has_signed_normals(source)
    on_sheet = same_sheet(sites.feet.points[by[rows]], sites.normals[by[rows]], y, n, band.spacing, signed)
    on_sheet &= np.linalg.norm(y - sites.feet.points[nodes[rows]], axis=1) > SAME_FOOT_SPACINGS * band.spacing
    chosen = np.flatnonzero(on_sheet)
    chosen = chosen[np.unique(rows[chosen], return_index=True)[1]]
    nodes, unknown = nodes[rows[chosen]], missing.unknown[rows[chosen]]
    return sites.grown(nodes, _with_distances(band, nodes, feet.take(chosen)), n[chosen], unknown)


def _is_served(source: LocalSource, band: Band, sites: Sites, count: int, missing: MissingSites) -> Bools:
    """Return which missing sites the new twins provide: the sites from ``count`` on, at most one a node."""
    new, by = np.arange(count, len(sites)), missing.by
    twin = new[np.minimum(np.searchsorted(sites.base[new], missing.nodes), len(new) - 1)]
    served = (sites.base[twin] == missing.nodes) & (sites.unknown[twin] | ~missing.unknown)
    wanted_site, twin_site = (sites.feet.points[by], sites.normals[by]), (sites.feet.points[twin], sites.normals[twin])
    return np.asarray(served & same_sheet(*wanted_site, *twin_site, band.spacing, has_signed_normals(source)))


def _with_distances(band: Band, nodes: Ints, feet: ClosestPoints) -> ClosestPoints:
    """Return feet with their distances from the nodes that stand on them."""
    return replace(feet, distance=np.linalg.norm(band.positions[nodes] - feet.points, axis=1))
