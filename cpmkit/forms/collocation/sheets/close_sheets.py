"""Sheets that are too near to each other to be parted, and stencils that read another sheet although they were."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.forms.collocation.sheets.sheets import same_sheet
from cpmkit.forms.collocation.sheets.turning import foot_directions
from cpmkit.grid.band import Band
from cpmkit.grid.stencils import stencil_cells, stencil_nodes, tensor_weights
from cpmkit.protocols import Bools, Floats, Ints, Rows

#: Feet of neighbouring nodes this many spacings above each other, where normals are parallel, lie on two sheets.
UNSEEN_GAP_SPACINGS = 0.1
#: Where closest points are the nearest ones, the height is exact up to the third order of what lies between the feet.
UNSEEN_EXACT_GAP_SPACINGS = 0.02
#: Members of a union touch where their feet are nearer than so many spacings.
TOUCHING_MEMBERS_SPACINGS = 1e-4
#: Normals are parallel, whatever their sign, above this cosine.
PARALLEL_COSINE = 0.8
#: Where closest points stand for a surface that only their normals know, feet this much higher for each spacing along
#: it are on one sheet: normals of a smooth mesh lean against its triangles.
LEANING_SLOPE = 1.0
#: this multiple of the slope that pairs of nodes on one side show, if that is less.
LEANING_FACTOR = 4.0
#: A stencil is hardly disturbed if the absolute weights with which it reads another sheet sum up to less than this. The
#: share of the surface whose stencils read more is about the error, in percent: 0.7 beside 1.9 on a torus whose hole is
#: 1.4 spacings wide, 0.7 beside 0.8 on Spot, 3.7 beside 2.4 on the koala, 3.4 beside 2.0 on Nefertiti; 8.9 beside 1.9
#: on the fish.
NOTICED_FOREIGN_WEIGHT = 0.01


@dataclass(frozen=True, eq=False)
class Gaps(Rows):
    """Places where two sheets are taken for one.

    Attributes
    ----------
    places : (n, d) float64
        Feet, relative to the lattice's origin.
    width : (n,) float64
        Distance between the sheets; infinite where the stencil reads a flank that is not parallel.
    """

    places: Floats
    width: Floats

    def narrower(self, width: float) -> Gaps:
        """Return the places where the sheets are nearer than ``width``."""
        return self.take(self.width < width)


def find_unseen_gaps(band: Band, exact: bool, united: bool = False) -> Gaps:
    """Return where neighbouring nodes have feet on two parallel sheets that count as one.

    ``exact`` says whether the surface's closest points are its nearest ones, ``united`` whether it is a union, whose
    feet name their member.
    """
    away = foot_directions(band)
    first, second = _sound_pairs(band, away.sound)
    along = np.sum(away.unit[first] * away.unit[second], axis=1, keepdims=True)
    n, beside = away.unit[first], np.where(along < 0, -away.unit[second], away.unit[second])
    y, z = band.feet.points[first], band.feet.points[second]
    height = 0.5 * np.abs(np.sum((z - y) * (n + beside), axis=1))
    bend = 0.5 * np.linalg.norm(z - y, axis=1) * np.linalg.norm(n - beside, axis=1)
    flat = np.sqrt(np.maximum(np.sum((z - y) ** 2, axis=1) - height**2, 0.0))
    allowed = bend + UNSEEN_EXACT_GAP_SPACINGS * band.spacing
    if not exact:
        slope = height / np.maximum(flat, UNSEEN_GAP_SPACINGS * band.spacing)
        leaning = _allowed_slope(first, second, along[:, 0] > 0, slope, len(band.nodes))
        least = np.clip(leaning, UNSEEN_EXACT_GAP_SPACINGS, UNSEEN_GAP_SPACINGS)
        allowed = bend + least * band.spacing + leaning * flat
    if united and band.feet.element is not None:
        touching = (UNSEEN_EXACT_GAP_SPACINGS - TOUCHING_MEMBERS_SPACINGS) * band.spacing
        allowed[band.feet.element[first] != band.feet.element[second]] -= touching
    apart = (np.abs(along[:, 0]) > PARALLEL_COSINE) & (height > allowed)
    if band.sheets is not None:
        s = band.sheets
        apart &= same_sheet(y, s.normals[first], z, s.normals[second], band.spacing, s.signed)
    return Gaps(np.concatenate([y[apart], z[apart]]), np.tile(height[apart], 2))


def _allowed_slope(first: Ints, second: Ints, alike: Bools, slope: Floats, count: int) -> Floats:
    """Return how much higher for each spacing along it feet of pairs (n,) may be on one sheet, because normals lean.

    Pairs whose nodes are on one side of the surface show how much they do; between sheets only the others are apart.
    """
    lean = np.zeros(count)
    np.maximum.at(lean, np.concatenate([first, second]), np.tile(np.where(alike, slope, 0.0), 2))
    return np.where(
        alike, LEANING_SLOPE, np.minimum(LEANING_SLOPE, LEANING_FACTOR * np.maximum(lean[first], lean[second]))
    )


def _sound_pairs(band: Band, sound: Bools) -> tuple[Ints, Ints]:
    """Return pairs (n,), (n,) of inner nodes that are neighbours along an axis, and of those on both sides of a node.

    That node is one that does not tell its normal: between two sheets that nearly touch it is on both. No twins.
    """
    pairs = []
    nodes = np.flatnonzero(sound[: band.first_twin])
    for axis in np.eye(band.dim, dtype=np.int64):
        beside = band.find_inner(band.nodes[nodes] + axis)
        hidden = (beside >= 0) & ~sound[beside]
        beside[hidden] = band.find_inner(band.nodes[nodes[hidden]] + 2 * axis)
        kept = (beside >= 0) & sound[beside]
        pairs.append(np.stack([nodes[kept], beside[kept]]))
    return tuple(np.concatenate(pairs, axis=1))


def find_mixed_gaps(band: Band) -> Gaps:
    """Return where stencils still read another sheet, with weights that matter, and how far from their own it is."""
    if band.sheets is None or not len(band.sheets.mixed):
        return Gaps(np.zeros((0, band.dim)), np.zeros(0))
    sheets, rows, points = band.sheets, band.sheets.mixed, band.feet.points
    cells, fractions = stencil_cells(points[rows], band.spacing, band.degree)
    columns = stencil_nodes(band, cells).astype(np.int64)
    columns, missed = sheets.select_twins(
        band.feet.take(rows), sheets.normals[rows], columns, np.arange(len(points)) < band.inner, every=True
    )
    foreign = np.zeros(columns.shape, dtype=bool)
    foreign[missed.row, missed.column] = True
    y, n, z, other = points[rows][:, None], sheets.normals[rows][:, None], points[columns], sheets.normals[columns]
    parallel = np.abs(np.sum(n * other, axis=-1)) > PARALLEL_COSINE
    height = np.where(foreign & parallel, np.abs(np.sum((z - y) * n, axis=-1)), np.inf)
    read = np.sum(np.abs(tensor_weights(fractions, band.degree)) * foreign, axis=1)
    return Gaps(points[rows], height.min(axis=1)).take(read > NOTICED_FOREIGN_WEIGHT)
