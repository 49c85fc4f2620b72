"""Nodes with their feet while twins are being created, and the sites that stencils still miss."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.forms.collocation.sheets.sheets import REUSED_ROW_SPACINGS, Sheets
from cpmkit.grid.band import Band
from cpmkit.grid.stencils import cross_offsets, stencil_cells, stencil_nodes
from cpmkit.manifold.local_source import LocalSource
from cpmkit.protocols import Bools, ClosestPoints, Floats, Ints, Rows


@dataclass(frozen=True, eq=False)
class Sites(Rows):
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
    anchor : (m,) int64
        The site from whose foot a twin's was found by unfolding; the site itself for all others.
    """

    base: Ints
    feet: ClosestPoints
    normals: Floats
    unknown: Bools
    anchor: Ints

    def grown(self, base: Ints, feet: ClosestPoints, normals: Floats, unknown: Bools, anchor: Ints | None) -> Sites:
        """Return the sites with further ones; without ``anchor`` these are their own."""
        anchor = len(self) + np.arange(len(base)) if anchor is None else anchor
        return self.join([self, Sites(base, feet, normals, unknown, anchor)])

    def sheets(self, source: LocalSource, band: Band, unfolded: bool) -> Sheets:
        """Return the table of twins, the first sites being those of the band itself."""
        first, twins = twins_by_site(self.base, np.arange(len(band.nodes), len(self)))
        nodes, nothing = band.nodes[self.base], np.zeros(0, dtype=np.int64)
        return Sheets(
            source, band.spacing, nodes, self.feet, self.normals, self.anchor, first, twins, unfolded, nothing
        )


def twins_by_site(base: Ints, twins: Ints) -> tuple[Ints, Ints]:
    """Return where each site's ``twins`` begin (m + 1,), and the twins in that order; their sites: ``base[twins]``."""
    twins = twins[np.argsort(base[twins], kind="stable")]
    return np.searchsorted(base[twins], np.arange(len(base) + 1)).astype(np.int64), twins


@dataclass(frozen=True, eq=False)
class MissingSites(Rows):
    """Sites that stencils miss on their own sheet, sorted by node; of one node, those where u is read come first.

    Attributes
    ----------
    nodes : (k,) int64
        Numbers of nodes in the band.
    by : (k,) int64
        Sites at whose feet the stencils are.
    unknown : (k,) bool
        True where u is read, False where only E u is.
    feet : ClosestPoints
        Where the nodes have their feet if the surface is unfolded; else those of ``by``.
    """

    nodes: Ints
    by: Ints
    unknown: Bools
    feet: ClosestPoints


def find_missing(source: LocalSource, band: Band, sites: Sites, queue: Ints, unfolded: bool) -> MissingSites:
    """Return the sites missed by the stencils of ``queue``, those of E and those of the unknowns' differences.

    Differences of a twin that was found by unfolding are taken on the plane that the surface was unfolded on: its
    neighbours, too, are found from its anchor.
    """
    sheets, n = sites.sheets(source, band, unfolded), sites.normals
    cells = stencil_cells(sites.feet.points[queue], band.spacing, band.degree)[0]
    read = stencil_nodes(band, cells).astype(np.int64)
    _, in_stencils = sheets.select_twins(sites.feet.take(queue), n[queue], read, sites.unknown, every=True)
    centres = queue[sites.unknown[queue]]
    around = band.find(band.nodes[sites.base[centres]][:, None] + cross_offsets(band.dim))
    anchors, all_sites = sites.anchor[centres], np.ones(len(sites), dtype=bool)
    _, in_differences = sheets.select_twins(
        sites.feet.take(anchors), n[anchors], around, all_sites, REUSED_ROW_SPACINGS, every=True
    )
    nodes = sites.base[
        np.concatenate([read[in_stencils.row, in_stencils.column], around[in_differences.row, in_differences.column]])
    ]
    unknown = np.repeat([True, False], [len(in_stencils.row), len(in_differences.row)])
    by = np.concatenate([queue[in_stencils.row], anchors[in_differences.row]])
    order = np.lexsort((~unknown, nodes))
    return MissingSites(nodes, by, unknown, ClosestPoints.join([in_stencils.feet, in_differences.feet])).take(order)
