"""Boundaries that run beside a rim of the manifold, nearer to it than a spacing, or on it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cpmkit.forms.collocation.boundary.side_view import BoundaryOnLattice
from cpmkit.forms.collocation.encounters.boundaries import STRIP_SPACINGS
from cpmkit.forms.collocation.ghosts.geometry import ALONGSIDE_COSINE
from cpmkit.grid.band import Band
from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.tangent_space import outward_conormals
from cpmkit.protocols import Floats, Ints

#: One nearer than this many spacings lies on it.
ON_RIM_SPACINGS = 1e-3
#: So many samples of a curve lie on a rim only where it runs along it; a curve that ends there has one or two.
RIM_RUN_SAMPLES = 3
#: Step, in spacings, of the differences that give a rim's conormal, and how far past the rim its foot is looked for.
RIM_CONORMAL_STEP_SPACINGS, PAST_RIM_SPACINGS = 0.005, 0.05


@dataclass(frozen=True, eq=False)
class RimStrip:
    """A boundary beside a rim.

    Attributes
    ----------
    boundary : int
        Its number.
    loop : int
        The rim's.
    points : (k, d) float64
        Places of the boundary that are beside the rim, nearest first, in the scene's coordinates.
    width : float
        The least distance.
    on_rim : bool
        True where the boundary runs along the rim itself.
    """

    boundary: int
    loop: int
    points: Floats
    width: float
    on_rim: bool


def find_rim_strips(on_lattice: Sequence[BoundaryOnLattice], surface: LocalSource, band: Band) -> list[RimStrip]:
    """Return the boundaries beside rims, relative to the lattice's origin; nothing is asked for without rims."""
    past = np.flatnonzero(band.feet.edge >= 0)
    sided = [(number, one) for number, one in enumerate(on_lattice) if one.has_sides and len(past)]
    return [strip for number, one in sided for strip in _beside(number, one, surface, band, past)]


def _beside(number: int, one: BoundaryOnLattice, surface: LocalSource, band: Band, past: Ints) -> list[RimStrip]:
    from scipy.spatial import cKDTree

    h, points = band.spacing, surface.closest_point(one.samples).points
    away, nearest = cKDTree(band.feet.points[past]).query(points)
    close = np.flatnonzero(away < 3 * STRIP_SPACINGS * h)
    if not len(close):
        return []
    points, rim = points[close], band.feet.take(past[nearest[close]])
    outward = outward_conormals(surface, rim, RIM_CONORMAL_STEP_SPACINGS * h)
    inside = np.sum((rim.points - points) * outward, axis=1, keepdims=True)
    foot = surface.closest_point(points + (inside + PAST_RIM_SPACINGS * h) * outward)
    width = np.linalg.norm(foot.points - points, axis=1)
    seen = one.side_view(points, h, h)
    beside = (width[seen.rows] < STRIP_SPACINGS * h) & (foot.edge[seen.rows] >= 0) & ~seen.end
    beside &= np.abs(np.sum(seen.conormal * outward[seen.rows], axis=1)) > ALONGSIDE_COSINE
    rows = seen.rows[beside]
    rows = rows[np.argsort(width[rows], kind="stable")]
    if not len(rows):
        return []
    on_rim = width[rows] < ON_RIM_SPACINGS * h
    along = bool(on_rim.all() or on_rim.sum() >= RIM_RUN_SAMPLES)
    return [RimStrip(number, int(foot.edge[rows[0]]), points[rows], float(width[rows[0]]), along)]
