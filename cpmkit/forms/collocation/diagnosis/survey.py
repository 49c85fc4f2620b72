"""Finding what the sheets of a band leave, from the closest points that a layout has already asked for.

The numbers behind the expected errors are in docs/explanation/sheets.md.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cpmkit.forms.collocation.diagnosis.remainder import WORTH, Remainder
from cpmkit.forms.collocation.diagnosis.valleys import limbs_of
from cpmkit.forms.collocation.layout import Layout
from cpmkit.forms.collocation.sheets.close_sheets import gaps_of_mixed, unseen_gaps
from cpmkit.forms.collocation.sheets.turning import Turns, directions, look_closely, reach_of, sharp_turns, widest
from cpmkit.grid.band import Band
from cpmkit.protocols import Bools, Floats, Ints

#: Error, as a share of the range, over the angle in radians of a crease that all of the flux crosses: where the crease
#: runs along an axis of the lattice, and where it is oblique to all of them and its errors average out.
ALONG, OBLIQUE = 0.2, 0.08
#: A crease runs along an axis of the lattice above this cosine.
ALIGNED = 0.999
#: The error of a bend is that of a crease of the same turn, and falls tenfold with so many spacings of radius.
TENFOLD = 2.0
#: Nodes this near to the surface, in spacings, are as dense as its area.
NEAR = 0.5
#: Feet within so many spacings of a sharp bend, or of a stencil that mixes sheets, belong to it.
BESIDE = 0.5
#: So many places that turn sharply are looked at closely.
SAMPLE = 128
#: Places in one cell of a grid of so many spacings count as one.
CELL = 0.5
#: Where the sharpest curvature times the spacing is below this, there is no crease.
BLUNT = 0.5
#: Of what bends too sharply, this share is resolved at the spacing that is told.
RESOLVED = 0.9
#: Sheets this many spacings apart are parted.
PARTED = 1.0


def surveyed(layout: Layout) -> bool:
    """True where :func:`remaining` finds something if there is something: on hypersurfaces whose sheets are parted."""
    return layout.options.own.sheets and layout.order < 4 and layout.surface.manifold_dim == layout.surface.dim - 1


def remaining(layout: Layout, spacing: float | None = None) -> tuple[Remainder, ...]:
    """Return what is worth telling of what parting the sheets of a layout leaves.

    Parameters
    ----------
    layout : Layout
        Which is looked at.
    spacing : float, optional
        For which it is judged, where the layout is a coarser rehearsal.
    """
    if not surveyed(layout):
        return ()
    seen = _survey(layout, layout.lattice.spacing if spacing is None else spacing)
    if not len(seen.feet):
        return ()
    turns = [one for one in (_creases(seen), _bends(seen)) if one is not None and one.error >= WORTH]
    kinds = {one.kind for one in turns}
    creases, bends = seen.creased & ("crease" in kinds), ~seen.creased & ("bend" in kinds)
    limbs = limbs_of(layout) if seen.spacing == layout.lattice.spacing else None
    mixed = [one for one in _mixtures(seen, seen.turns.places[creases], seen.turns.places[bends]) if one.error >= WORTH]
    return *turns, *([] if limbs is None else [limbs]), *mixed


@dataclass(frozen=True, eq=False)
class _Survey:
    """Where a surface turns sharply, and feet (n, d) that are spread over it as densely as its area."""

    layout: Layout
    spacing: float
    feet: Floats
    turns: Turns
    creased: Bools
    angle: Floats
    aligned: Bools

    @property
    def band(self) -> Band:
        return self.layout.band

    @property
    def half_stencil(self) -> float:
        """Half the width of a stencil of the band, in units of length."""
        return 0.5 * (self.band.degree + 1) * self.band.spacing

    def place(self, point: Floats) -> tuple[float, ...]:
        """Return a point relative to the lattice's origin in the scene's coordinates."""
        return tuple(self.layout.lattice.to_scene(point[None])[0].tolist())


def _survey(layout: Layout, spacing: float) -> _Survey:
    band, h = layout.band, layout.band.spacing
    own = band.first_twin
    near = (directions(band).length[:own] <= NEAR * h) & (band.feet.edge[:own] < 0)
    turns = sharp_turns(band, 1 / (reach_of(band.dim, band.degree) * h))
    feet = band.feet.points[:own][near]
    if len(turns.places):
        turns = widest(turns, CELL * h)
    if turns.curvature.max(initial=0.0) * h < BLUNT:
        none = np.zeros(len(turns.places))
        return _Survey(layout, spacing, feet, turns, none > 0, none, none > 0)
    sample = np.unique(np.linspace(0, len(turns.places) - 1, SAMPLE).astype(np.int64))
    closely = look_closely(layout.surface, turns.take(sample), h)
    like = _nearest(turns.places[sample], turns.places)[1]
    turns = replace(turns, curvature=np.minimum(turns.curvature, closely.curvature[like]))
    one_sheet = closely.one_sheet[like]  # the others span two sheets and say nothing of how these turn
    like, turns = like[one_sheet], turns.take(one_sheet)
    aligned = np.abs(closely.along).max(axis=1) > ALIGNED
    return _Survey(layout, spacing, feet, turns, closely.creased[like], closely.angle[like], aligned[like])


def _creases(seen: _Survey) -> Remainder | None:
    at = np.flatnonzero(seen.creased)
    if not len(at):
        return None
    h, dim = seen.band.spacing, seen.band.dim
    beside = float(_beside(seen.turns.places[at], seen.feet, seen.half_stencil).mean())
    area = len(seen.feet) * h ** (dim - 1)
    across = 1.0
    if dim == 3:  # a crease that is shorter than the surface is wide lets part of the flux pass beside it
        length = beside * area / (2 * seen.half_stencil)
        across = min(1.0, length / np.sqrt(0.5 * area))
    angle = seen.angle[at]
    each = angle * np.where(seen.aligned[at] | (dim == 2), ALONG, OBLIQUE)
    return Remainder(
        "crease",
        share=min(1.0, beside * seen.spacing / h),
        typical=float(np.rad2deg(np.median(angle))),
        worst=float(np.rad2deg(np.quantile(angle, RESOLVED))),
        error=float(min(1.0, each.mean() * across)),
        cure=None,
        place=seen.place(seen.turns.places[at[np.argsort(angle)[int(RESOLVED * (len(at) - 1))]]]),
    )


def _bends(seen: _Survey) -> Remainder | None:
    """Tell of bends; on a curve all that flows passes the sharpest, on a surface their errors add up in mean square.

    The plain mean over the surface is too small by up to six where bends take up a small share of it, as rims do. What
    is sharper than most bends counts like these: facets of a mesh, for one.
    """
    reach = reach_of(seen.band.dim, seen.band.degree)
    turns = seen.turns.take(~seen.creased & (seen.turns.curvature * seen.spacing * reach > 1))
    if not len(turns.places):
        return None
    distance, which = _nearest(turns.places, seen.feet)
    bent = distance < BESIDE * seen.band.spacing
    if not bent.any():
        return None
    curvature = turns.curvature[which[bent]]
    turned = np.minimum(2 * seen.half_stencil / seen.band.spacing * seen.spacing * curvature, np.pi)
    error = ALONG * turned * 10.0 ** (-1 / (TENFOLD * curvature * seen.spacing))
    blunted = np.minimum(error, np.quantile(error, RESOLVED))
    return Remainder(
        "bend",
        share=float(bent.mean()),
        typical=float(1 / np.median(curvature)),
        worst=float(1 / curvature.max()),
        error=float(error.max() if seen.band.dim == 2 else np.sqrt(np.sum(blunted**2) / len(bent))),
        cure=float(1 / (reach * np.quantile(curvature, RESOLVED))),
        place=seen.place(seen.feet[bent][curvature.argmax()]),
    )


def _mixtures(seen: _Survey, creases: Floats, bends: Floats) -> list[Remainder]:
    """Tell of sheets that are too near to each other, and of stencils that read another sheet for no such reason.

    Not of those beside creases (n, d) that are told of already, nor of flanks of bends (n, d): parallel sheets beside a
    bend are no part of it.
    """
    gaps, h = gaps_of_mixed(seen.band), seen.band.spacing
    reach = reach_of(seen.band.dim, seen.band.degree) * h
    explained = _beside(creases, gaps.places, reach) | (_beside(bends, gaps.places, reach) & np.isinf(gaps.width))
    gaps = gaps.take(~explained)
    close = gaps.narrower(PARTED * seen.spacing)
    surface = seen.layout.surface
    unseen = unseen_gaps(seen.band, surface.source.exact, len(surface.members) > 1).narrower(PARTED * seen.spacing)
    lost = gaps.take(gaps.width >= PARTED * h)
    found = []
    width, places = np.concatenate([close.width, unseen.width]), np.concatenate([close.places, unseen.places])
    if len(places):
        mixed = _beside(close.places, seen.feet, BESIDE * h) | _beside(unseen.places, seen.feet, seen.half_stencil)
        share, typical, worst = float(mixed.mean()), float(np.median(width)), float(width.min())
        cure = float(np.quantile(width, 1 - RESOLVED)) / PARTED
        found.append(Remainder("sheets", share, typical, worst, share, cure, seen.place(places[width.argmin()])))
    if len(lost.places) and seen.spacing == h:
        share = float(_beside(lost.places, seen.feet, BESIDE * h).mean())
        found.append(Remainder("lost", share, 0.0, 0.0, share, None, seen.place(lost.places[0])))
    return found


def _beside(places: Floats, feet: Floats, radius: float) -> Bools:
    """Return which of the feet lie within ``radius`` of one of the places."""
    return _nearest(places, feet)[0] < radius if len(places) else np.zeros(len(feet), dtype=bool)


def _nearest(places: Floats, points: Floats) -> tuple[Floats, Ints]:
    """Return how far the nearest of ``places`` is from each of ``points``, and its number."""
    from scipy.spatial import cKDTree

    distance, number = cKDTree(places).query(points)
    return np.asarray(distance), np.asarray(number, dtype=np.int64)
