"""Finding features that a layout does not resolve, from the closest points that it already holds.

The numbers behind the expected errors are in docs/explanation/sheets.md.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cpmkit.forms.collocation.diagnosis.corners import (
    ERROR_PER_RADIAN_ALIGNED,
    corner_feature,
    is_curve_in_space,
)
from cpmkit.forms.collocation.diagnosis.unresolved import TOLD_ERROR_SHARE, UnresolvedFeature
from cpmkit.forms.collocation.diagnosis.valleys import limb_feature
from cpmkit.forms.collocation.layout import Layout
from cpmkit.forms.collocation.sheets.close_sheets import find_mixed_gaps, find_unseen_gaps
from cpmkit.forms.collocation.sheets.turning import (
    Turns,
    bisect_turns,
    foot_directions,
    foot_reach_spacings,
    sharp_turns,
    strongest_per_cell,
)
from cpmkit.grid.band import Band
from cpmkit.protocols import Bools, Floats, Ints

#: The same where the crease is oblique to all axes of the lattice and its errors average out.
ERROR_PER_RADIAN_OBLIQUE = 0.08
#: A crease runs along an axis of the lattice above this cosine.
ALIGNED_CREASE_COSINE = 0.999
#: A bend costs as much as a crease of the same angle, and ten times less for each so many spacings of its radius.
TENFOLD_RADIUS_SPACINGS = 2.0
#: Nodes within so many spacings of the surface sample its area evenly.
NEAR_SURFACE_SPACINGS = 0.5
#: Feet within so many spacings of a sharp bend, or of a stencil that mixes sheets, belong to it.
BESIDE_BEND_SPACINGS = 0.5
#: Number of sharp turns that are examined by bisection.
TURN_SAMPLE = 128
#: Places in one cell of a grid of so many spacings count as one.
PLACE_CELL_SPACINGS = 0.5
#: Where the sharpest curvature times the spacing is below this, there is no crease.
BLUNT_CURVATURE = 0.5
#: The spacing named as a remedy resolves this share of what bends too sharply.
RESOLVED_SHARE = 0.9
#: Sheets at least so many spacings apart are separated.
SEPARATE_SHEETS_SPACINGS = 1.0


def can_find_unresolved(layout: Layout) -> bool:
    """True where :func:`find_unresolved` applies: on hypersurfaces whose sheets are separated."""
    return layout.options.own.sheets and layout.order < 4 and layout.surface.manifold_dim == layout.surface.dim - 1


def find_unresolved(layout: Layout, spacing: float | None = None) -> tuple[UnresolvedFeature, ...]:
    """Return unresolved features above the reporting threshold.

    Parameters
    ----------
    layout : Layout
        Which is looked at.
    spacing : float, optional
        For which it is judged, where the layout is a coarser rehearsal.
    """
    if is_curve_in_space(layout):
        corners = corner_feature(layout)
        return () if corners is None else (corners,)
    if not can_find_unresolved(layout):
        return ()
    survey = _survey(layout, layout.lattice.spacing if spacing is None else spacing)
    if not len(survey.feet):
        return ()
    turns = [one for one in (_sharp_creases(survey), _sharp_bends(survey)) if one and one.error >= TOLD_ERROR_SHARE]
    kinds = {feature.kind for feature in turns}
    creases, bends = survey.creased & ("crease" in kinds), ~survey.creased & ("bend" in kinds)
    limbs = limb_feature(layout) if survey.spacing == layout.lattice.spacing else None
    mixed = _close_sheets(survey, survey.turns.places[creases], survey.turns.places[bends])
    return *turns, *([limbs] if limbs else []), *(one for one in mixed if one.error >= TOLD_ERROR_SHARE)


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
    untwinned = band.first_twin
    near = (foot_directions(band).length[:untwinned] <= NEAR_SURFACE_SPACINGS * h) & (band.feet.edge[:untwinned] < 0)
    turns = sharp_turns(band, 1 / (foot_reach_spacings(band.dim, band.degree) * h))
    feet = band.feet.points[:untwinned][near]
    if len(turns.places):
        turns = strongest_per_cell(turns, PLACE_CELL_SPACINGS * h)
    if turns.curvature.max(initial=0.0) * h < BLUNT_CURVATURE:
        none = np.zeros(len(turns.places))
        return _Survey(layout, spacing, feet, turns, none > 0, none, none > 0)
    sample = np.unique(np.linspace(0, len(turns.places) - 1, TURN_SAMPLE).astype(np.int64))
    profile = bisect_turns(layout.surface, turns.take(sample), h)
    nearest_sampled = _nearest(turns.places[sample], turns.places)[1]
    turns = replace(turns, curvature=np.minimum(turns.curvature, profile.curvature[nearest_sampled]))
    one_sheet = profile.one_sheet[nearest_sampled]  # the others span two sheets and say nothing of how these turn
    nearest_sampled, turns = nearest_sampled[one_sheet], turns.take(one_sheet)
    aligned = np.abs(profile.along).max(axis=1) > ALIGNED_CREASE_COSINE
    of_turns: Any = [values[nearest_sampled] for values in (profile.creased, profile.angle, aligned)]
    return _Survey(layout, spacing, feet, turns, *of_turns)


def _sharp_creases(survey: _Survey) -> UnresolvedFeature | None:
    creased = np.flatnonzero(survey.creased)
    if not len(creased):
        return None
    h, dim = survey.band.spacing, survey.band.dim
    beside = float(_lie_beside(survey.turns.places[creased], survey.feet, survey.half_stencil).mean())
    area = len(survey.feet) * h ** (dim - 1)
    across = 1.0
    if dim == 3:  # a crease that is shorter than the surface is wide lets part of the flux pass beside it
        length = beside * area / (2 * survey.half_stencil)
        across = min(1.0, length / np.sqrt(0.5 * area))
    angle = survey.angle[creased]
    each = angle * np.where(survey.aligned[creased] | (dim == 2), ERROR_PER_RADIAN_ALIGNED, ERROR_PER_RADIAN_OBLIQUE)
    return UnresolvedFeature(
        "crease",
        share=min(1.0, beside * survey.spacing / h),
        typical=float(np.rad2deg(np.median(angle))),
        worst=float(np.rad2deg(np.quantile(angle, RESOLVED_SHARE))),
        error=float(min(1.0, each.mean() * across)),
        cure=None,
        place=survey.place(survey.turns.places[creased[np.argsort(angle)[int(RESOLVED_SHARE * (len(creased) - 1))]]]),
    )


def _sharp_bends(survey: _Survey) -> UnresolvedFeature | None:
    """Return the bends: on a curve the flux passes the sharpest one, on a surface their errors add up in mean square.

    The plain mean over the surface is too small by up to six where bends take up a small share of it, as rims do. What
    is sharper than most bends counts like these: facets of a mesh, for one.
    """
    reach = foot_reach_spacings(survey.band.dim, survey.band.degree)
    turns = survey.turns.take(~survey.creased & (survey.turns.curvature * survey.spacing * reach > 1))
    if not len(turns.places):
        return None
    distance, which = _nearest(turns.places, survey.feet)
    bent = distance < BESIDE_BEND_SPACINGS * survey.band.spacing
    if not bent.any():
        return None
    curvature = turns.curvature[which[bent]]
    turned = np.minimum(2 * survey.half_stencil / survey.band.spacing * survey.spacing * curvature, np.pi)
    error = ERROR_PER_RADIAN_ALIGNED * turned * 10.0 ** (-1 / (TENFOLD_RADIUS_SPACINGS * curvature * survey.spacing))
    blunted = np.minimum(error, np.quantile(error, RESOLVED_SHARE))
    return UnresolvedFeature(
        "bend",
        share=float(bent.mean()),
        typical=float(1 / np.median(curvature)),
        worst=float(1 / curvature.max()),
        error=float(error.max() if survey.band.dim == 2 else np.sqrt(np.sum(blunted**2) / len(bent))),
        cure=float(1 / (reach * np.quantile(curvature, RESOLVED_SHARE))),
        place=survey.place(survey.feet[bent][curvature.argmax()]),
    )


def _close_sheets(survey: _Survey, creases: Floats, bends: Floats) -> list[UnresolvedFeature]:
    """Return sheets too near to each other, and stencils that read another sheet for no such reason.

    Places beside creases (n, d) already reported and flanks of bends (n, d) are left out; parallel sheets beside a bend
    count.
    """
    gaps, h = find_mixed_gaps(survey.band), survey.band.spacing
    reach = foot_reach_spacings(survey.band.dim, survey.band.degree) * h
    explained = _lie_beside(bends, gaps.places, reach) & np.isinf(gaps.width)
    gaps = gaps.take(~explained & ~_lie_beside(creases, gaps.places, reach))
    close = gaps.narrower(SEPARATE_SHEETS_SPACINGS * survey.spacing)
    surface = survey.layout.surface
    unseen = find_unseen_gaps(survey.band, surface.source.exact, len(surface.members) > 1)
    unseen = unseen.narrower(SEPARATE_SHEETS_SPACINGS * survey.spacing)
    lost = gaps.take(gaps.width >= SEPARATE_SHEETS_SPACINGS * h)
    features = []
    width, places = np.concatenate([close.width, unseen.width]), np.concatenate([close.places, unseen.places])
    if len(places):
        mixed = _lie_beside(close.places, survey.feet, BESIDE_BEND_SPACINGS * h)
        mixed |= _lie_beside(unseen.places, survey.feet, survey.half_stencil)
        share, typical, worst = float(mixed.mean()), float(np.median(width)), float(width.min())
        cure = float(np.quantile(width, 1 - RESOLVED_SHARE)) / SEPARATE_SHEETS_SPACINGS
        features.append(
            UnresolvedFeature("sheets", share, typical, worst, share, cure, survey.place(places[width.argmin()]))
        )
    if len(lost.places) and survey.spacing == h:
        share = float(_lie_beside(lost.places, survey.feet, BESIDE_BEND_SPACINGS * h).mean())
        features.append(UnresolvedFeature("lost", share, 0.0, 0.0, share, None, survey.place(lost.places[0])))
    return features


def _lie_beside(places: Floats, feet: Floats, radius: float) -> Bools:
    """Return which of the feet lie within ``radius`` of one of the places."""
    return _nearest(places, feet)[0] < radius if len(places) else np.zeros(len(feet), dtype=bool)


def _nearest(places: Floats, points: Floats) -> tuple[Floats, Ints]:
    """Return how far the nearest of ``places`` is from each of ``points``, and its number."""
    from scipy.spatial import cKDTree

    distance, number = cKDTree(places).query(points)
    return np.asarray(distance), np.asarray(number, dtype=np.int64)
