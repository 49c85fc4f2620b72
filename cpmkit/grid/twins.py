"""Finding the twins of a band's nodes: where stencils reach another sheet than the one that they are centred on.

Only closest points and further feet are asked for, and only near places where closest points of neighbouring nodes lie
on different sheets.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cpmkit.boundary.tangent_space import normals
from cpmkit.grid.band import Band
from cpmkit.grid.extension import stencil_nodes
from cpmkit.grid.lattice import find
from cpmkit.grid.sheets import Sheets, same_sheet
from cpmkit.grid.stencils import cross_offsets, stencil_cells, tensor_offsets
from cpmkit.grid.walking import feet_from
from cpmkit.localized import Localized
from cpmkit.protocols import Bools, ClosestPoints, Floats, Ints

#: Closest points of neighbouring nodes that lie this many spacings above each other hint at two sheets.
STEP_UP = 0.3
#: A node nearer to its foot than this many spacings does not tell the normal.
TOUCHING = 0.1
#: At most so many rounds in which twins ask for further twins; the first two bring nearly all.
GENERATIONS = 8
#: At most so many twins a node gets in one round.
AT_ONCE = 4
#: A foot nearer to the node's own than this many spacings is the same.
SAME = 0.1


@dataclass(frozen=True, eq=False)
class Sites:
    """Nodes with their feet: first those of the band, each with its closest point, then twins in the order found.

    Attributes
    ----------
    base : (m,) int64
        Number of each site's node in the band.
    feet : ClosestPoints
        Of the sites.
    normals : (m, d) float64
        At the feet.
    unknown : (m,) bool
        True for those that stencils read.
    """

    base: Ints
    feet: ClosestPoints
    normals: Floats
    unknown: Bools

    def __len__(self) -> int:
        return len(self.base)

    def sheets(self, source: Localized, count: int) -> Sheets:
        """Return the table of twins, ``count`` of the sites being those of the band itself."""
        first, twins = _by_site(self.base, np.arange(count, len(self)))
        nothing = np.zeros(0, dtype=np.int64)
        return Sheets(source, has_signed_normals(source), self.normals, first, twins, nothing)


def _by_site(base: Ints, twins: Ints) -> tuple[Ints, Ints]:
    """Return where each site's ``twins`` begin (m + 1,), and the twins in that order; their sites: ``base[twins]``."""
    twins = twins[np.argsort(base[twins], kind="stable")]
    return np.searchsorted(base[twins], np.arange(len(base) + 1)).astype(np.int64), twins


def has_signed_normals(source: Localized) -> bool:
    """Tell whether a surface's normals have a sign of their own everywhere."""
    return all(member.has_normals for member in source.members)


def part_sheets(source: Localized, band: Band) -> Band:
    """Return the band with twins where several sheets share its nodes; the band itself where none do.

    Parameters
    ----------
    source : Localized
        A hypersurface; of any other manifold the band is returned as it is.
    band : Band
        With the closest points of its nodes.
    """
    if source.manifold_dim != source.dim - 1:
        return band
    flagged = conflicting(band)
    if not flagged.any():
        return band
    inner = np.arange(len(band.nodes)) < band.inner
    sites = Sites(np.arange(len(band.nodes)), band.feet, normals(source, band.feet, 0.5 * band.spacing), inner)
    queue = near = _rows_near(band, flagged)
    for _ in range(GENERATIONS):
        wanted = _wanted(source, band, sites, queue)
        grown = _answered(source, band, sites, wanted)
        if len(grown) == len(sites):
            break
        queue, sites = np.arange(len(sites), len(grown)), grown
    if len(sites) == len(band.nodes):
        return band
    readers = np.concatenate([near, np.arange(len(band.nodes), len(sites))])
    return _with_twins(source, band, sites, np.unique(_wanted(source, band, sites, readers).by))


def conflicting(band: Band) -> Bools:
    """Return which nodes have a neighbour whose closest point lies above or below their own.

    The direction from a foot to its node is the normal there: no source is asked.
    """
    h, flagged = band.spacing, np.zeros(len(band.nodes), dtype=bool)
    away = band.positions - band.feet.points
    length = np.linalg.norm(away, axis=1)
    direction = np.where((length > TOUCHING * h)[:, None], away / np.maximum(length, TOUCHING * h)[:, None], 0.0)
    for axis in np.eye(band.dim, dtype=np.int64):
        beside = band.find(band.nodes + axis)
        one = np.flatnonzero(beside >= 0)
        other = beside[one]
        chord = band.feet.points[other] - band.feet.points[one]
        step = np.maximum(
            np.abs(np.sum(chord * direction[one], axis=1)), np.abs(np.sum(chord * direction[other], axis=1))
        )
        jumps = step > STEP_UP * h
        flagged[one[jumps]] = flagged[other[jumps]] = True
    return flagged


def _rows_near(band: Band, flagged: Bools) -> Ints:
    """Return the sites whose stencils, of interpolation or differences, may hold a flagged node."""
    nodes = band.nodes[np.flatnonzero(flagged[: band.inner])]
    around = (nodes[:, None] - tensor_offsets(band.degree, band.dim)).reshape(-1, band.dim)
    cells = np.unique(band.codes.encode(around))
    own = band.codes.encode(stencil_cells(band.feet.points, band.spacing, band.degree)[0])
    near = find(cells, own) >= 0
    for offset in cross_offsets(band.dim):
        beside = band.find(band.nodes + offset)
        near |= (beside >= 0) & flagged[beside]
    return np.flatnonzero(near | flagged)


@dataclass(frozen=True, eq=False)
class _Wanted:
    """Nodes (k,) that the stencils of sites ``by`` (k,) want on their own sheet, to read or only to take E u from."""

    nodes: Ints
    by: Ints
    unknown: Bools


def _wanted(source: Localized, band: Band, sites: Sites, queue: Ints) -> _Wanted:
    sheets = sites.sheets(source, len(band.nodes))
    readers = queue
    cells = stencil_cells(sites.feet.points[readers], band.spacing, band.degree)[0]
    stencils = stencil_nodes(band, cells).astype(np.int64)
    by_stencil = _missing(band, sites, sheets, readers, stencils, readable=True)
    centres = queue[sites.unknown[queue]]
    around = band.find(band.nodes[sites.base[centres]][:, None] + cross_offsets(band.dim))
    by_difference = _missing(band, sites, sheets, centres, around, readable=False)
    parts = (by_stencil, by_difference)
    nodes, by = (np.concatenate([part[k] for part in parts]) for k in range(2))
    unknown = np.repeat([True, False], [len(by_stencil[0]), len(by_difference[0])])
    return _Wanted(nodes, by, unknown)


def _missing(band: Band, sites: Sites, sheets: Sheets, rows: Ints, columns: Ints, readable: bool) -> tuple[Ints, Ints]:
    """Return nodes of stencils that have no site on the stencil's sheet, and whose stencils these are."""
    feet, n = sites.feet.points, sites.normals
    columns = columns.copy()
    allowed = sites.unknown if readable else np.ones(len(sites), dtype=bool)
    sheets.choose(feet[rows], n[rows], columns, feet, band.spacing, allowed)
    row, column = np.nonzero(columns < len(band.nodes))
    site = columns[row, column]
    foreign = ~same_sheet(feet[rows[row]], n[rows[row]], feet[site], n[site], band.spacing, sheets.signed)
    return site[foreign], rows[row[foreign]]


def _answered(source: Localized, band: Band, sites: Sites, wanted: _Wanted) -> Sites:
    """Return the sites with twins for the nodes that are wanted; one serves all that are on its sheet."""
    order = np.lexsort((~wanted.unknown, wanted.nodes))
    nodes, by, unknown = wanted.nodes[order], wanted.by[order], wanted.unknown[order]
    for _ in range(AT_ONCE):
        if not len(nodes):
            break
        _, first = np.unique(nodes, return_index=True)
        twins = _twins_at(source, band, sites, nodes[first], by[first], unknown[first])
        left = np.ones(len(nodes), dtype=bool)
        left[first] = False
        if len(twins):
            left &= ~_served(source, band, sites, twins, nodes, by, unknown)
            sites = Sites(
                np.concatenate([sites.base, twins.base]),
                ClosestPoints.join([sites.feet, twins.feet]),
                np.concatenate([sites.normals, twins.normals]),
                np.concatenate([sites.unknown, twins.unknown]),
            )
        nodes, by, unknown = nodes[left], by[left], unknown[left]
    return sites


def _served(source: Localized, band: Band, sites: Sites, twins: Sites, nodes: Ints, by: Ints, unknown: Bools) -> Bools:
    """Tell which of the wants (nodes ascending) the new twins, at most one a node, fulfil."""
    place = np.minimum(np.searchsorted(twins.base, nodes), len(twins) - 1)
    served = (twins.base[place] == nodes) & (twins.unknown[place] | ~unknown)
    own: Bools = same_sheet(
        sites.feet.points[by],
        sites.normals[by],
        twins.feet.points[place],
        twins.normals[place],
        band.spacing,
        has_signed_normals(source),
    )
    return np.asarray(served & own)


def _twins_at(source: Localized, band: Band, sites: Sites, nodes: Ints, by: Ints, unknown: Bools) -> Sites:
    """Return new sites of ``nodes`` on the sheets of the sites ``by``, where there are any.

    Of the feet that a node has, the nearest on the sheet is taken.
    """
    rows, feet = feet_from(source, band.positions[nodes], sites.feet.take(by), band.spacing)
    y, n = feet.points, normals(source, feet, 0.5 * band.spacing)
    signed = has_signed_normals(source)
    own = same_sheet(sites.feet.points[by[rows]], sites.normals[by[rows]], y, n, band.spacing, signed)
    own &= np.linalg.norm(y - sites.feet.points[nodes[rows]], axis=1) > SAME * band.spacing
    chosen = np.flatnonzero(own)
    chosen = chosen[np.unique(rows[chosen], return_index=True)[1]]
    nodes, unknown, feet = nodes[rows[chosen]], unknown[rows[chosen]], feet.take(chosen)
    feet = replace(feet, distance=np.linalg.norm(band.positions[nodes] - feet.points, axis=1))
    return Sites(nodes, feet, n[chosen], unknown)


def _with_twins(source: Localized, band: Band, sites: Sites, mixed: Ints) -> Band:
    """Return the band with the twins among its sites: unknown ones after the inner nodes, others after the outer."""
    count = len(band.nodes)
    later = np.arange(count, len(sites))
    order = np.concatenate(
        [np.arange(band.inner), later[sites.unknown[later]], np.arange(band.inner, count), later[~sites.unknown[later]]]
    )
    new = np.empty(len(sites), dtype=np.int64)
    new[order] = np.arange(len(sites))
    base = new[sites.base[order]]
    first, twins = _by_site(base, np.flatnonzero(order >= count))
    return Band(
        band.spacing,
        band.degree,
        band.nodes[sites.base[order]],
        band.inner + int(sites.unknown[later].sum()),
        sites.feet.take(order),
        band.codes,
        band.inner,
        count - band.inner,
        Sheets(source, has_signed_normals(source), sites.normals[order], first, twins, new[mixed]),
    )
