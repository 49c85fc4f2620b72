"""Boundaries that run beside a rim, nearer to it than the nodes past it.

A node past the edge reads the manifold at a mirror point inside. Where a boundary lies between the rim and that point,
the node is on the rim's side of it all the same: it continues the strip between the two, at first order, for no mirror
point has room there. A ghost past the edge continues what lies behind a boundary that runs alongside, by the boundary's
condition and not by the edge's; where one ends on the edge, both conditions hold.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cpmkit.forms.collocation.boundary.row_formula import RowFormula
from cpmkit.forms.collocation.boundary.side_view import BoundaryOnLattice, SideView
from cpmkit.forms.collocation.ghosts.geometry import ALONGSIDE_COSINE
from cpmkit.grid.band import Band
from cpmkit.manifold.tangent_space import outward_conormals
from cpmkit.protocols import Bools, Floats, Ints

#: Feet nearer to a boundary than this many spacings do not tell the way to it.
UNDIRECTED_FOOT_SPACINGS = 0.1


def mirrors_cut_off(on_lattice: Sequence[BoundaryOnLattice], band: Band, mirrored: RowFormula, radius: float) -> Ints:
    """Return the nodes (k,) past an edge whose mirror points lie beyond a boundary, as seen from their feet."""
    past = np.flatnonzero((band.feet.edge >= 0) & (mirrored.points != band.feet.points).any(axis=1))
    apart = np.zeros(len(past), dtype=bool)
    for one in on_lattice:
        if one.has_sides and len(past):
            at_feet = one.side_view(band.feet.points[past], radius, band.spacing)
            at_mirror = one.side_view(mirrored.points[past[at_feet.rows]], radius, band.spacing)
            at_feet = at_feet.take(at_mirror.rows)
            opposite = (np.sum(at_mirror.director * at_feet.director, axis=1) < 0) & ~at_mirror.end & ~at_feet.end
            apart[at_feet.rows[opposite]] = True
    return past[apart]


def replaced(reading: RowFormula, rows: Ints, other: RowFormula) -> RowFormula:
    """Return a reading whose ``rows`` are those of another, which has no terms."""
    if not len(rows):
        return reading
    points, coefficient = reading.points.copy(), reading.coefficient.copy()
    points[rows], coefficient[rows] = other.points[rows], other.coefficient[rows]
    chosen = np.isin(np.arange(len(reading)), rows)
    here, there = np.where(chosen, -1, np.arange(len(reading))), np.where(chosen, np.arange(len(reading)), -1)
    data = [datum.renumbered(here) for datum in reading.data] + [datum.renumbered(there) for datum in other.data]
    terms = [term.take(~chosen[term.rows]) for term in reading.terms]
    feet = reading.feet
    if feet is not None and other.feet is not None:
        feet = feet.replaced(rows, other.feet.take(rows))
    return RowFormula(points, coefficient, data, terms, feet)


def straight_ahead(
    on_lattice: BoundaryOnLattice, band: Band, side_view: SideView, behind: Ints
) -> tuple[SideView, Floats, Bools]:
    """Return the view of nodes with those past an edge behind a boundary where they stand, their places, and which.

    Those are the nodes ``behind`` and others to whose feet the boundary runs parallel inside. They stand in the
    tangent plane of the edge, at places (g, d); zero for all others, whose entries stay as they are.
    """
    places, apart = np.zeros((len(side_view.rows), band.dim)), np.zeros(len(side_view.rows), dtype=bool)
    past = np.flatnonzero(band.feet.edge[side_view.rows] >= 0)
    nodes = side_view.rows[past]
    feet = band.feet.take(nodes)
    outward = outward_conormals(on_lattice.surface, feet, 0.5 * band.spacing)
    apart[past] = np.isin(nodes, behind) | _parallel(side_view.take(past), feet.points, outward, band.spacing)
    beyond = np.maximum(np.sum((band.positions[nodes] - feet.points) * outward, axis=1, keepdims=True), 0.0)
    places[past] = feet.points + beyond * outward
    on = on_lattice.surface.closest_point(on_lattice.source.closest_point(places[apart]).points).points
    foot, distance = side_view.foot.copy(), side_view.distance.copy()
    foot[apart], distance[apart] = on, np.linalg.norm(places[apart] - on, axis=1)
    return replace(side_view, foot=foot, distance=distance), places, apart


def _parallel(side_view: SideView, feet: Floats, outward: Floats, spacing: float) -> Bools:
    """Tell at which feet on an edge the boundary runs alongside it, on the inner side."""
    away = feet - side_view.foot
    inwards, length = np.sum(away * outward, axis=1), np.linalg.norm(away, axis=1)
    across = np.abs(np.sum(side_view.conormal * outward, axis=1)) > ALONGSIDE_COSINE
    return np.asarray(across & ((length < UNDIRECTED_FOOT_SPACINGS * spacing) | (inwards > ALONGSIDE_COSINE * length)))
