"""Finding the twins of a band's nodes: where stencils reach another sheet than the one that they are centred on.

Only closest points and further feet are asked for, and only near places where closest points of neighbouring nodes lie
on different sheets.
"""

from __future__ import annotations

import numpy as np

from cpmkit.forms.collocation.sheets.foot_directions import ON_FOOT_SPACINGS, foot_directions
from cpmkit.forms.collocation.sheets.new_twins import add_twins_at_feet
from cpmkit.forms.collocation.sheets.sheets import Sheets
from cpmkit.forms.collocation.sheets.sites import Sites, find_missing, twins_by_site
from cpmkit.grid.band import Band
from cpmkit.grid.lattice import find
from cpmkit.grid.stencils import cross_offsets, stencil_cells, tensor_offsets
from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.tangent_space import unit_normals
from cpmkit.protocols import Bools, Ints

#: A height difference (spacings) between feet of neighbouring nodes that suggests two sheets.
SHEET_STEP_SPACINGS = 0.3
#: Most rounds in which new twins may need further twins; the first two find nearly all.
MOST_TWIN_ROUNDS = 8


def separate_sheets(source: LocalSource, band: Band) -> Band:
    """Return the band with twins where several sheets share its nodes; the band itself where none do.

    Parameters
    ----------
    source : LocalSource
        A hypersurface; of any other manifold the band is returned as it is.
    band : Band
        With the closest points of its nodes.
    """
    if source.manifold_dim != source.dim - 1:
        return band
    flagged = nodes_between_sheets(band)
    if not flagged.any():
        return band
    every = np.arange(len(band.nodes))
    sites = Sites(every, band.feet, unit_normals(source, band.feet, 0.5 * band.spacing), every < band.inner)
    queue = near = _rows_near(band, flagged)
    for _ in range(MOST_TWIN_ROUNDS):
        grown = add_twins_at_feet(source, band, sites, find_missing(source, band, sites, queue))
        if len(grown) == len(sites):
            break
        queue, sites = np.arange(len(sites), len(grown)), grown
    if len(sites) == len(band.nodes):
        return band
    readers = np.concatenate([near, np.arange(len(band.nodes), len(sites))])
    mixed = np.unique(find_missing(source, band, sites, readers).by)
    return _with_twins(source, band, sites, mixed)


def nodes_between_sheets(band: Band) -> Bools:
    """Return which nodes have a neighbour whose closest point lies above or below their own.

    The direction from a foot to its node is the normal there: no source is asked.
    """
    h, flagged = band.spacing, np.zeros(len(band.nodes), dtype=bool)
    away = foot_directions(band)
    direction = np.where((away.length > ON_FOOT_SPACINGS * h)[:, None], away.unit, 0.0)
    for axis in np.eye(band.dim, dtype=np.int64):
        beside = band.find(band.nodes + axis)
        first = np.flatnonzero(beside >= 0)
        second = beside[first]
        chord = band.feet.points[second] - band.feet.points[first]
        steps = [np.abs(np.sum(chord * direction[end], axis=1)) for end in (first, second)]
        jumps = np.maximum(*steps) > SHEET_STEP_SPACINGS * h
        flagged[first[jumps]] = flagged[second[jumps]] = True
    return flagged


def _rows_near(band: Band, flagged: Bools) -> Ints:
    """Return the sites whose stencils, of interpolation or differences, may hold a flagged node."""
    nodes = band.nodes[np.flatnonzero(flagged[: band.inner])]
    around = (nodes[:, None] - tensor_offsets(band.degree, band.dim)).reshape(-1, band.dim)
    cells = np.unique(band.codes.encode(around))
    cell_of_site = band.codes.encode(stencil_cells(band.feet.points, band.spacing, band.degree)[0])
    near = find(cells, cell_of_site) >= 0
    for offset in cross_offsets(band.dim):
        beside = band.find(band.nodes + offset)
        near |= (beside >= 0) & flagged[beside]
    return np.flatnonzero(near | flagged)


def _with_twins(source: LocalSource, band: Band, sites: Sites, mixed: Ints) -> Band:
    """Return the band with the twins among its sites: unknown ones after the inner nodes, others after the outer."""
    count = len(band.nodes)
    later = np.arange(count, len(sites))
    order = np.concatenate(
        [np.arange(band.inner), later[sites.unknown[later]], np.arange(band.inner, count), later[~sites.unknown[later]]]
    )
    new = np.empty(len(sites), dtype=np.int64)
    new[order] = np.arange(len(sites))
    first, twins = twins_by_site(new[sites.base[order]], np.flatnonzero(order >= count))
    nodes, feet = band.nodes[sites.base[order]], sites.feet.take(order)
    n, inner = sites.normals[order], band.inner + int(sites.unknown[later].sum())
    sheets = Sheets(source, band.spacing, nodes, feet, n, first, twins, new[mixed])
    return Band(band.spacing, band.degree, nodes, inner, feet, band.codes, band.inner, count - band.inner, sheets)
