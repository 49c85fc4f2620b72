"""The creases of a level set, where a kink of its formula makes the gradient jump, and samples of what they bound."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from cpmkit.plugin import Floats, norms
from cpmkit_levelset.fields import Field
from cpmkit_levelset.formulas import FormulaField
from cpmkit_levelset.manifold import MOST_PROJECTIONS, ON_SURFACE_SHARE, ZeroSet, unit_or_nan
from cpmkit_levelset.sampling import COVERING_SPACINGS
from cpmkit_levelset.search import ON_CREASE_COVERINGS, LayeredSet, build_layer

#: The gradients on both sides of a crease are taken at this distance from it, relative to the size.
CREASE_STEP_SHARE = 1e-7
#: Creases that turn by less than this angle, in radians, are none.
LEAST_CREASE_ANGLE = 1e-3


def crease_kinks(field: Field, samples: Floats, size: float, spacing: float) -> tuple[FormulaField, ...]:
    """Return the kinks of ``field`` at whose zeros its gradient jumps somewhere on the level set.

    ``samples`` (n, d) are those of the level set, taken from a lattice of ``spacing``.
    """
    return tuple(
        kink
        for kink in (field.kinks if isinstance(field, FormulaField) else ())
        if _gradient_jumps(field, kink, common_points(ZeroSet((field, kink), size), samples, spacing), size).any()
    )


def layered_set(zero_set: ZeroSet, samples: Floats, kinks: tuple[FormulaField, ...], spacing: float) -> LayeredSet:
    """Return the level set ``zero_set`` as faces, with creases at zeros of ``kinks`` and corners where creases meet.

    An edge, of two fields, has arcs in place of faces, and corners at the zeros of kinks. ``samples`` (n, d) are those
    of the set, taken from a lattice of ``spacing``. A face or arc has one sign of each kink.
    """
    covering, size = COVERING_SPACINGS * spacing, zero_set.size
    creases = [ZeroSet((zero_set.fields[-1], kink), size) for kink in kinks]
    on_faces = samples
    for crease in creases:  # a descent that starts on a crease may take either face's slope
        on_faces = on_faces[crease.distance_estimate(on_faces) > ON_CREASE_COVERINGS * covering]
    signs = np.array([kink.value(on_faces) > 0 for kink in kinks]).reshape(len(kinks), len(on_faces))
    face = np.unique(signs, axis=1, return_inverse=True)[1].reshape(-1)
    layers = [build_layer(zero_set, on_faces[face == k], covering, tuple(creases)) for k in range(face.max() + 1)]
    if len(zero_set.fields) == 2:
        corners = [_corner_points((*zero_set.fields, kink), samples, size, spacing) for kink in kinks]
        return LayeredSet(tuple(layers), np.concatenate([np.empty((0, samples.shape[1])), *corners]))
    found = [common_points(crease, samples, spacing) for crease in creases]
    for kink, crease, points in zip(kinks, creases, found, strict=True):
        on_crease = points[_gradient_jumps(zero_set.fields[0], kink, points, size)]
        layers.append(build_layer(crease, on_crease, covering, tuple(each for each in creases if each is not crease)))
    pairs = combinations(range(len(kinks)), 2) if samples.shape[1] == 3 else ()
    corners = [_corner_points((zero_set.fields[0], kinks[i], kinks[j]), found[i], size, spacing) for i, j in pairs]
    return LayeredSet(tuple(layers), np.concatenate([np.empty((0, samples.shape[1])), *corners]))


def common_points(common: ZeroSet, samples: Floats, spacing: float) -> Floats:
    """Return points (k, d) of ``common``, onto which those of ``samples`` (n, d) near it are projected."""
    near = samples[common.distance_estimate(samples) <= 1.5 * spacing]
    points, converged = common.project(near, 3 * spacing)
    return points[converged]


def _gradient_jumps(field: Field, kink: FormulaField, points: Floats, size: float) -> np.ndarray:
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
