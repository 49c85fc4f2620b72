"""Separation of the sheets of a surface: the twins of a band's nodes.

Twins are needed where stencils contain nodes whose closest points are on another sheet than the stencil's centre.
Further feet are computed only near places where closest points of neighbouring nodes are on different sheets.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cpmkit.forms.collocation.band_sheets import (
    ON_FOOT_SPACINGS,
    Sheets,
    foot_directions,
    has_signed_normals,
    same_sheet,
)
from cpmkit.grid.band import Band, cross_offsets, stencil_cells, stencil_nodes, tensor_offsets
from cpmkit.grid.lattice import find_codes
from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.source import ClosestPoints, Rows
from cpmkit.manifold.tangent_space import feet_on_sheets, unit_normals
from cpmkit.manifold.vector_algebra import dots, norms
from cpmkit.types import Bools, Floats, Ints

#: The least difference of height, in spacings, between feet of neighbouring nodes that suggests two sheets.
SHEET_STEP_SPACINGS = 0.3
#: Most rounds in which new twins may need further twins (the first two find nearly all), and most twins that a node
#: gets in one round: one for each sheet that it lies between.
MOST_TWIN_ROUNDS, TWINS_PER_ROUND = 8, 4


@dataclass(frozen=True, eq=False)
class Sites(Rows):
    """Nodes with their feet while twins are added: the band's nodes first, then twins in the order found."""

    base: Ints  #: (m,): number of each site's node in the band.
    feet: ClosestPoints  #: Feet of the sites.
    normals: Floats  #: (m, d): unit normals at the feet.
    unknown: Bools  #: (m,): whether interpolation stencils read the site.

    def sheets(self, source: LocalSource, band: Band) -> Sheets:
        """Return the twins of the ``band`` of the surface ``source``, for choosing stencils; ``mixed`` is empty."""
        first, twins = _twins_by_site(self.base, np.arange(len(band.nodes), len(self)))
        return Sheets(source, band.spacing, self.feet, self.normals, first, twins, np.zeros(0, dtype=np.int64))


@dataclass(frozen=True, eq=False)
class MissingSites(Rows):
    """Nodes without a site on the sheet of a stencil that reads them, sorted by node, those where u is read first."""

    nodes: Ints  #: (k,): numbers of the nodes in the band.
    by: Ints  #: (k,): the sites whose stencils read the nodes.
    unknown: Bools  #: (k,): True where u is read, False where only E u is read.


def add_twins(source: LocalSource, band: Band) -> Band:
    """Return the band of a hypersurface with twins, copies of nodes for further sheets; other bands are unchanged."""
    if source.manifold_dim != source.dim - 1:
        return band
    flagged = nodes_between_sheets(band)
    if not flagged.any():
        return band
    every = np.arange(len(band.nodes))
    sites = Sites(every, band.feet, unit_normals(source, band.feet, 0.5 * band.spacing), every < band.inner)
    queue = flagged_readers = _find_readers(band, flagged)
    for _ in range(MOST_TWIN_ROUNDS):
        grown = _with_twins(source, band, sites, find_missing_sites(source, band, sites, queue))
        if len(grown) == len(sites):
            break
        queue, sites = np.arange(len(sites), len(grown)), grown
    if len(sites) == len(band.nodes):
        return band
    readers = np.concatenate([flagged_readers, np.arange(len(band.nodes), len(sites))])
    mixed = np.unique(find_missing_sites(source, band, sites, readers).by)
    return _band_with_twins(source, band, sites, mixed)


def nodes_between_sheets(band: Band) -> Bools:
    """Return whether (n,) the foot of some neighbour of each node is 0.3 spacings off the node's, along a normal."""
    h, flagged = band.spacing, np.zeros(len(band.nodes), dtype=bool)
    directions = foot_directions(band)
    normal = np.where((directions.length > ON_FOOT_SPACINGS * h)[:, None], directions.unit, 0.0)
    for axis in np.eye(band.dim, dtype=np.int64):
        neighbour = band.find(band.nodes + axis)
        first = np.flatnonzero(neighbour >= 0)
        second = neighbour[first]
        chord = band.feet.points[second] - band.feet.points[first]
        heights = [np.abs(dots(chord, normal[end])) for end in (first, second)]
        jumps = np.maximum(*heights) > SHEET_STEP_SPACINGS * h
        flagged[first[jumps]] = flagged[second[jumps]] = True
    return flagged


def _find_readers(band: Band, flagged: Bools) -> Ints:
    """Return the nodes (k,) whose interpolation or difference stencils may contain a node with ``flagged`` (n,)."""
    nodes = band.nodes[np.flatnonzero(flagged[: band.inner])]
    around = (nodes[:, None] - tensor_offsets(band.degree, band.dim)).reshape(-1, band.dim)
    cells = np.unique(band.codes.encode(around))
    cell_of_site = band.codes.encode(stencil_cells(band.feet.points, band.spacing, band.degree)[0])
    reads_flagged = find_codes(cells, cell_of_site) >= 0
    for offset in cross_offsets(band.dim):
        neighbour = band.find(band.nodes + offset)
        reads_flagged |= (neighbour >= 0) & flagged[neighbour]
    return np.flatnonzero(reads_flagged | flagged)


def find_missing_sites(source: LocalSource, band: Band, sites: Sites, queue: Ints) -> MissingSites:
    """Return the nodes for which stencils of the sites ``queue`` (q,) have no site on their own sheet.

    Stencils are the interpolation stencils of these sites, and the difference stencils of those that are unknowns.
    """
    sheets, n = sites.sheets(source, band), sites.normals
    cells = stencil_cells(sites.feet.points[queue], band.spacing, band.degree)[0]
    read = stencil_nodes(band, cells).astype(np.int64)
    _, in_stencils = sheets.select_twins(sites.feet.take(queue), n[queue], read, sites.unknown, every=True)
    centres = queue[sites.unknown[queue]]
    around = band.find(band.nodes[sites.base[centres]][:, None] + cross_offsets(band.dim))
    all_sites = np.ones(len(sites), dtype=bool)
    _, in_differences = sheets.select_twins(sites.feet.take(centres), n[centres], around, all_sites, every=True)
    nodes = sites.base[np.concatenate([read[in_stencils], around[in_differences]])]
    unknown = np.repeat([True, False], [len(in_stencils[0]), len(in_differences[0])])
    by = np.concatenate([queue[in_stencils[0]], centres[in_differences[0]]])
    return MissingSites(nodes, by, unknown).take(np.lexsort((~unknown, nodes)))


def _with_twins(source: LocalSource, band: Band, sites: Sites, missing: MissingSites) -> Sites:
    """Return the sites with twins for those ``missing`` whose nodes have a foot on the needed sheet."""
    unserved = missing
    for _ in range(TWINS_PER_ROUND):
        if not len(unserved.nodes):
            break
        first = np.unique(unserved.nodes, return_index=True)[1]
        count = len(sites)
        sites = _with_one_twin_each(source, band, sites, unserved.take(first))
        remaining = np.ones(len(unserved.nodes), dtype=bool)
        remaining[first] = False
        if len(sites) > count:
            remaining &= ~_is_served(source, band, sites, count, unserved)
        unserved = unserved.take(remaining)
    return sites


def _with_one_twin_each(source: LocalSource, band: Band, sites: Sites, missing: MissingSites) -> Sites:
    """Return the sites with a twin, the nearest foot, for each missing site whose node has a foot on the needed sheet.

    ``missing`` has each node at most once.
    """
    nodes, by = missing.nodes, missing.by
    rows, feet = feet_on_sheets(source, band.positions[nodes], sites.feet.take(by), band.spacing)
    y, n = feet.points, unit_normals(source, feet, 0.5 * band.spacing)
    signed = has_signed_normals(source)
    on_sheet = same_sheet(sites.feet.points[by[rows]], sites.normals[by[rows]], y, n, band.spacing, signed)
    on_sheet &= norms(y - sites.feet.points[nodes[rows]]) > ON_FOOT_SPACINGS * band.spacing
    chosen = np.flatnonzero(on_sheet)
    chosen = chosen[np.unique(rows[chosen], return_index=True)[1]]
    nodes, unknown, feet = nodes[rows[chosen]], missing.unknown[rows[chosen]], feet.take(chosen)
    feet = replace(feet, distance=norms(band.positions[nodes] - feet.points))
    return sites.join([sites, Sites(nodes, feet, n[chosen], unknown)])


def _is_served(source: LocalSource, band: Band, sites: Sites, count: int, missing: MissingSites) -> Bools:
    """Return whether (k,) the new twins, sites from ``count`` on, one a node at most, provide each missing site."""
    new, by = np.arange(count, len(sites)), missing.by
    twin = new[np.minimum(np.searchsorted(sites.base[new], missing.nodes), len(new) - 1)]
    served = (sites.base[twin] == missing.nodes) & (sites.unknown[twin] | ~missing.unknown)
    stencil, foot = (sites.feet.points[by], sites.normals[by]), (sites.feet.points[twin], sites.normals[twin])
    return np.asarray(served & same_sheet(*stencil, *foot, band.spacing, has_signed_normals(source)))


def _twins_by_site(base: Ints, twins: Ints) -> tuple[Ints, Ints]:
    """Return the starts (m + 1,) of each site's twins in a list sorted by site, and the list (t,) of ``twins`` (t,).

    The site k is a twin of the site ``base[k]``; ``base`` is (m,).
    """
    twins = twins[np.argsort(base[twins], kind="stable")]
    return np.searchsorted(base[twins], np.arange(len(base) + 1)).astype(np.int64), twins


def _band_with_twins(source: LocalSource, band: Band, sites: Sites, mixed: Ints) -> Band:
    """Return ``band`` with twins, copies of its nodes for further sheets: the ``sites`` after those of the nodes.

    Twins that interpolation stencils read follow the inner nodes, other twins are last. ``mixed`` (k,) are the sites
    whose stencils still read another sheet.
    """
    count = len(band.nodes)
    later = np.arange(count, len(sites))
    order = np.concatenate(
        [np.arange(band.inner), later[sites.unknown[later]], np.arange(band.inner, count), later[~sites.unknown[later]]]
    )
    new = np.empty(len(sites), dtype=np.int64)
    new[order] = np.arange(len(sites))
    first, twins = _twins_by_site(new[sites.base[order]], np.flatnonzero(order >= count))
    nodes, feet = band.nodes[sites.base[order]], sites.feet.take(order)
    inner = band.inner + int(sites.unknown[later].sum())
    sheets = Sheets(source, band.spacing, feet, sites.normals[order], first, twins, new[mixed])
    return Band(band.spacing, band.degree, nodes, inner, feet, band.codes, band.inner, count - band.inner, sheets)
