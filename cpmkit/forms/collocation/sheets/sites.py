"""Nodes with their feet while twins are being created, and the sites that stencils still miss."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.forms.collocation.sheets.sheets import Sheets
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
    """

    base: Ints
    feet: ClosestPoints
    normals: Floats
    unknown: Bools

    def grown(self, base: Ints, feet: ClosestPoints, normals: Floats, unknown: Bools) -> Sites:
        """Return the sites with further ones."""
        return self.join([self, Sites(base, feet, normals, unknown)])

    def sheets(self, source: LocalSource, band: Band) -> Sheets:
        """Return the table of twins, the first sites being those of the band itself."""
        first, twins = twins_by_site(self.base, np.arange(len(band.nodes), len(self)))
        nodes, nothing = band.nodes[self.base], np.zeros(0, dtype=np.int64)
        return Sheets(source, band.spacing, nodes, self.feet, self.normals, first, twins, nothing)


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
    """

    nodes: Ints
    by: Ints
    unknown: Bools


def find_missing(source: LocalSource, band: Band, sites: Sites, queue: Ints) -> MissingSites:
    """Return the sites missed by the stencils of ``queue``, those of E and those of the unknowns' differences."""
    sheets, n = sites.sheets(source, band), sites.normals
    cells = stencil_cells(sites.feet.points[queue], band.spacing, band.degree)[0]
    read = stencil_nodes(band, cells).astype(np.int64)
    _, in_stencils = sheets.select_twins(sites.feet.take(queue), n[queue], read, sites.unknown, every=True)
    centres = queue[sites.unknown[queue]]
    around = band.find(band.nodes[sites.base[centres]][:, None] + cross_offsets(band.dim))
    all_sites = np.ones(len(sites), dtype=bool)
    _, in_differences = sheets.select_twins(sites.feet.take(centres), n[centres], around, all_sites, every=True)
    nodes = sites.base[
        np.concatenate([read[in_stencils.row, in_stencils.column], around[in_differences.row, in_differences.column]])
    ]
    unknown = np.repeat([True, False], [len(in_stencils.row), len(in_differences.row)])
    by = np.concatenate([queue[in_stencils.row], centres[in_differences.row]])
    return MissingSites(nodes, by, unknown).take(np.lexsort((~unknown, nodes)))
