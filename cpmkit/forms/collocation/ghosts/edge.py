"""The rim of an open surface or the ends of an open curve: where nodes past the edge read.

King et al. (2024), eq. 5 (nodes past the edge), eq. 7 (their mirror points), eq. 8 (Dirichlet values).

A node whose foot lies on the edge reads the manifold at a mirror point inside, by the same formula as
a ghost, with z = y the foot, ``t = (x - y) . b`` and ``s = 2 (x - y) . b``. Zero Neumann, the default,
needs no conormal b: at order 2 the mirror ``cp_S(2 y - x)``, at order 1 the foot itself.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cpmkit.forms.collocation.boundary.row_formula import BoundaryData, RowFormula
from cpmkit.forms.collocation.ghosts.geometry import mirror_distance
from cpmkit.forms.collocation.ghosts.ghosts import coefficient_and_factor
from cpmkit.forms.collocation.ghosts.past_rim import replaced
from cpmkit.forms.collocation.ghosts.rim_corners import RimCorners, rim_corners
from cpmkit.grid.band import Band
from cpmkit.grid.lattice import Lattice
from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.tangent_space import outward_conormals
from cpmkit.manifold.walking import nearest_on_sheet
from cpmkit.protocols import ClosestPoints, Floats, Ints
from cpmkit.scene.edge_conditions import EdgeConditions, conditions_of_edge, edge_condition
from cpmkit.scene.laws import Flux, Mixed, OneSided, beta_at, is_zero_neumann

#: Nodes nearer to their foot than this share of the spacing do not tell the direction of the conormal.
UNDIRECTED_EDGE_SPACINGS = 1e-6
#: Named in errors.
EDGE_CONDITION = "the edge's condition"
#: Nodes past a loop of the edge, its law, and the order that it has of its own.
Loop = tuple[Ints, OneSided, int | None]


def read_past_edge(surface: LocalSource, band: Band, lattice: Lattice, edge: EdgeConditions, order: int) -> RowFormula:
    """Return what each node of the band reads, the edge's conditions applied to those past it."""
    return _mirrored(surface, band, lattice, edge, _loops(band, edge), order)


def read_at_feet(
    surface: LocalSource, band: Band, lattice: Lattice, edge: EdgeConditions, past: RowFormula, rows: Ints
) -> RowFormula:
    """Return ``past`` with the nodes ``rows`` past the edge of first order: they read their feet."""
    if not len(rows):
        return past
    return replaced(past, rows, _mirrored(surface, band, lattice, edge, _loops(band, edge, rows), 1, most=1))


def _loops(band: Band, edge: EdgeConditions, rows: Ints | None = None) -> list[Loop]:
    """Return the nodes past each edge loop, of ``rows`` or all, with its law and the order that it has of its own."""
    rows = np.arange(len(band.nodes)) if rows is None else rows
    loop_of, found = band.feet.edge[rows], []
    for loop in np.unique(loop_of[loop_of >= 0]):
        condition = edge_condition(edge, int(loop))
        found.append((rows[loop_of == loop], condition.one_sided, condition.order))
    return found


def _mirrored(
    surface: LocalSource,
    band: Band,
    lattice: Lattice,
    edge: EdgeConditions,
    loops: Sequence[Loop],
    order: int,
    most: int = 2,
) -> RowFormula:
    """Return what all nodes read at order 1 or 2, ``most``, one point each."""
    points, coefficient = band.feet.points.copy(), np.ones(len(band.nodes))
    feet = None if band.sheets is None else band.feet
    data: list[BoundaryData] = []
    for rows, law, own in loops:
        read = _mirror(surface, band, lattice, edge, law, min(own or order, most), rows)
        points[rows], coefficient[rows] = read.points, read.coefficient
        feet = None if feet is None or read.feet is None else feet.replaced(rows, read.feet)
        data += [datum.renumbered(rows) for datum in read.data]
    return RowFormula(points, coefficient, data, feet=feet)


def _mirror(
    surface: LocalSource, band: Band, lattice: Lattice, edge: EdgeConditions, law: OneSided, order: int, rows: Ints
) -> RowFormula:
    """Return what nodes past one loop read at order 1 or 2."""
    foot, beyond = band.feet.points[rows], band.positions[rows] - band.feet.points[rows]
    if is_zero_neumann(law) and not _has_flux(edge):
        on = band.feet.take(rows) if order == 1 else _reached(surface, band, rows, foot - beyond)
        return RowFormula(on.points, np.ones(len(rows)), feet=on)
    feet = band.feet.take(rows)
    conormals = outward_conormals(surface, feet, 0.5 * band.spacing)
    outward = _straight(surface, feet, conormals, beyond, band.spacing)
    t = np.maximum(np.sum(beyond * outward, axis=1), 0.0)
    mirror = foot - beyond - (mirror_distance(law, t, band.spacing) - t)[:, None] * outward
    on = feet if order == 1 else _reached(surface, band, rows, mirror)
    where = lattice.to_scene(foot)
    first = np.full(len(rows), order == 1)
    beta = beta_at(law, where, EDGE_CONDITION)
    corners = []
    if isinstance(law, Flux | Mixed):
        corners = _of_fluxes(rim_corners(surface, feet, beyond, conormals, band.spacing), edge, law)
    for one in corners:
        t[one.rows] = one.beyond.sum(axis=1)
    coefficient, factor = coefficient_and_factor(law, beta, t, 2 * t, first, band.spacing)
    datum = BoundaryData(np.arange(len(rows)), factor, where, law.datum, EDGE_CONDITION, law)
    data = _read_beside(datum, corners, edge, t, lattice)
    return RowFormula(on.points, coefficient, data, feet=on)


def _has_flux(edge: EdgeConditions) -> bool:
    """Tell whether a flux other than zero is given anywhere on the edge."""
    laws = [condition.one_sided for condition in conditions_of_edge(edge)]
    return any(isinstance(law, Flux | Mixed) and not is_zero_neumann(law) for law in laws)


def _of_fluxes(corners: Sequence[RimCorners], edge: EdgeConditions, law: OneSided) -> list[RimCorners]:
    """Return the corners of which all sides have the law of the node's own loop, or all a flux alone."""
    found = []
    for one in corners:
        kept = np.ones(len(one.rows), dtype=bool)
        for loop in np.unique(one.loops):
            other = edge_condition(edge, int(loop)).one_sided
            if other is not law and not (isinstance(law, Flux) and isinstance(other, Flux)):
                kept &= ((one.loops != loop) | (one.beyond == 0)).all(axis=1)
        if kept.any():
            found.append(one.take(kept))
    return found


def _read_beside(
    datum: BoundaryData, corners: Sequence[RimCorners], edge: EdgeConditions, t: Floats, lattice: Lattice
) -> list[BoundaryData]:
    """Return a flux (n,) with that of nodes at corners read on the sides of these, by how far they lie beyond each."""
    single, data = np.arange(len(t)), []
    for one in corners:
        single[one.rows] = -1
        shares = (datum.factor / np.where(t > 0, t, 1.0))[one.rows, None] * one.beyond
        for loop in np.unique(one.loops):
            k, side = np.nonzero((one.loops == loop) & (shares > 0))
            law = edge_condition(edge, int(loop)).one_sided
            where = lattice.to_scene(one.points[k, side])
            data.append(BoundaryData(one.rows[k], shares[k, side], where, law.datum, datum.what, law, at_corners=True))
    return [datum.renumbered(single), *data]


def _reached(surface: LocalSource, band: Band, rows: Ints, goal: Floats) -> ClosestPoints:
    """Return the points of the surface nearest to ``goal`` (n, d), on the nodes' own sheet where there are several."""
    return nearest_on_sheet(surface, _start(band, rows), goal, band.spacing)


def _start(band: Band, rows: Ints) -> ClosestPoints | None:
    """Return the records of the nodes' feet, to walk from along their sheets; None where the surface has one."""
    return None if band.sheets is None else band.feet.take(rows)


def _straight(surface: LocalSource, edge: ClosestPoints, conormals: Floats, beyond: Floats, spacing: float) -> Floats:
    """Return conormals of which those of solids are known to rounding: a node outside lies straight above its foot."""
    straight = surface.dimensions_at(edge) == surface.dim
    straight &= np.linalg.norm(beyond, axis=1) > UNDIRECTED_EDGE_SPACINGS * spacing
    outward = conormals.copy()
    outward[straight] = beyond[straight] / np.linalg.norm(beyond[straight], axis=1, keepdims=True)
    return outward
