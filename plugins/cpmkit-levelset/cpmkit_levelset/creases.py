"""The creases of a level set, where a kink of its formula makes the gradient jump, and samples of what they bound."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from cpmkit.plugin import Bools, Floats, norms
from cpmkit_levelset.fields import Field
from cpmkit_levelset.formulas import FormulaField
from cpmkit_levelset.manifold import MOST_PROJECTIONS, ON_SURFACE_SHARE, ZeroSet, unit_or_nan
from cpmkit_levelset.sampling import COVERING_SPACINGS
from cpmkit_levelset.search import ON_CREASE_COVERINGS, Layer, LayeredSet, build_layer

#: The gradients on both sides of a crease are taken at this distance from it, relative to the size.
CREASE_STEP_SHARE = 1e-7
#: Creases that turn by less than this angle, in radians, are none.
LEAST_CREASE_ANGLE = 1e-3


def surface_layers(zero_set: ZeroSet, samples: Floats, kinks: tuple[FormulaField, ...], spacing: float) -> LayeredSet:
    """Return a level set as faces, with creases at zeros of ``kinks`` and corners where creases meet.

    ``samples`` (n, d) are those of the set, taken from a lattice of ``spacing``. A face has one sign of each kink.
    Kinks at whose zeros the gradient jumps nowhere on the level set make no crease.
    """
    covering, (field,) = COVERING_SPACINGS * spacing, zero_set.fields
    found: dict[ZeroSet, tuple[Floats, Bools]] = {}
    for kink in kinks:
        crease = ZeroSet((field, kink), zero_set.size)
        points = common_points(crease, samples, spacing)
        jumps = _gradient_jumps(field, kink, points, zero_set.size)
        if jumps.any():
            found[crease] = points, jumps
    layers = _layers_of_faces(zero_set, samples, covering, tuple(found))
    for crease, (points, jumps) in found.items():
        others = tuple(other for other in found if other is not crease)
        layers.append(build_layer(crease, points[jumps], covering, others))
    pairs = combinations(found, 2) if samples.shape[1] == 3 else ()
    corners = [_corner_points((*a.fields, b.fields[1]), found[a][0], zero_set.size, spacing) for a, b in pairs]
    return LayeredSet(tuple(layers), np.concatenate([samples[:0], *corners]))


def edge_layers(zero_set: ZeroSet, samples: Floats, kinks: tuple[FormulaField, ...], spacing: float) -> LayeredSet:
    """Return the edge of a level set, of phi and the trim, as arcs with one sign of each of ``kinks``, and corners.

    ``samples`` (n, d) are those of the edge, taken from a lattice of ``spacing``.
    """
    creases = tuple(ZeroSet((zero_set.fields[1], kink), zero_set.size) for kink in kinks)
    layers = _layers_of_faces(zero_set, samples, COVERING_SPACINGS * spacing, creases)
    corners = [_corner_points((*zero_set.fields, kink), samples, zero_set.size, spacing) for kink in kinks]
    return LayeredSet(tuple(layers), np.concatenate([samples[:0], *corners]))


def _layers_of_faces(zero_set: ZeroSet, samples: Floats, covering: float, creases: tuple[ZeroSet, ...]) -> list[Layer]:
    """Return a layer for each combination of signs that the kinks of ``creases`` have at the ``samples`` (n, d)."""
    for crease in creases:  # a descent that starts on a crease may take either face's slope
        samples = samples[crease.distance_estimate(samples) > ON_CREASE_COVERINGS * covering]
    signs = np.array([crease.fields[1].value(samples) > 0 for crease in creases]).reshape(len(creases), len(samples))
    face = np.unique(signs, axis=1, return_inverse=True)[1].reshape(-1)
    return [build_layer(zero_set, samples[face == k], covering, creases) for k in range(face.max() + 1)]


def common_points(common: ZeroSet, samples: Floats, spacing: float) -> Floats:
    """Return points (k, d) of ``common``, onto which those of ``samples`` (n, d) near it are projected."""
    near = samples[common.distance_estimate(samples) <= 1.5 * spacing]
    points, converged = common.project(near, 3 * spacing)
    return points[converged]


def _gradient_jumps(field: Field, kink: FormulaField, points: Floats, size: float) -> Bools:
    """Return (n,) whether the gradient of ``field`` turns by LEAST_CREASE_ANGLE at ``points`` (n, d) on a ``kink``."""
    across = CREASE_STEP_SHARE * size * unit_or_nan(kink.gradient(points)[1])
    ahead, behind = (unit_or_nan(field.gradient(points + step)[1]) for step in (across, -across))
    return norms(ahead - behind) > LEAST_CREASE_ANGLE


def _corner_points(fields: tuple[Field, ...], samples: Floats, size: float, spacing: float) -> Floats:
    """Return the points (k, 3) at which three ``fields`` vanish, found by Newton's method from ``samples`` (n, 3).

    They lie within three of ``spacing`` from a sample; each occurs once.
    """
    start = points = samples
    for _ in range(MOST_PROJECTIONS):
        values, gradients = zip(*(field.gradient(points) for field in fields), strict=True)
        slopes = np.nan_to_num(np.stack(gradients, axis=1))
        regular = np.abs(np.linalg.det(slopes)) > 1e-6 * np.prod(np.linalg.norm(slopes, axis=2), axis=1)
        start, points, slopes = start[regular], points[regular], slopes[regular]
        step = np.linalg.solve(slopes, np.stack(values, axis=1)[regular][:, :, None])[:, :, 0]
        points = points - step
        near = norms(points - start) <= 3 * spacing
        start, points, step = start[near], points[near], step[near]
    points = points[norms(step) <= ON_SURFACE_SHARE * size]
    kept = np.unique(np.round(points / (1e3 * ON_SURFACE_SHARE * size)), axis=0, return_index=True)[1]
    return points[kept]
