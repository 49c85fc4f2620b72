"""One polynomial height field for each sample, fitted to its nearest neighbours by weighted least squares."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from cpmkit.plugin import Bools, Floats, Ints, run_parcels, unit

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

#: Samples fitted at a time.
FITTED_PARCEL_SAMPLES = 2048
#: A singular value this much smaller than the largest leaves its coefficient undetermined.
RANK_TOLERANCE = 1e-7
#: Falls to exp(-2) at the rim of the neighbourhood: heavier middles fit noise, flatter ones the far curvature.
WEIGHT_DECAY = 2.0
#: Neighbours with normals: how many times as many are looked at, for some lie on another sheet.
CANDIDATE_FACTOR = 3


@dataclass(frozen=True, eq=False)
class Patches:
    """The height fields: in the frame at sample i, with (a, b, c) in units of ``radii[i]``, c = sum of c_t a^i b^j.

    Attributes
    ----------
    degree : int
        The highest degree.
    neighbours : int
        Samples that a patch was fitted to, its own included.
    frames : (n, d, d) float64
        Rows: the tangents, then the normal, of arbitrary sign.
    radii : (n,) float64
        Distance to the farthest neighbour that took part in the fit.
    coefficients : (n, terms) float64
        Of the monomials that :func:`exponents` lists for two variables, in its order, for a curve too.
    thickness : (n,) float64
        How far the neighbours stray from their plane, relative to how far they spread in it (standard deviations).
    degrees : (n,) int64
        The degree that the neighbours determine: lower than requested where they are too few or lie badly.
    """

    degree: int
    neighbours: int
    frames: Floats
    radii: Floats
    coefficients: Floats
    thickness: Floats
    degrees: Ints


def curvatures(patches: Patches) -> Floats:
    """Return (n,) the larger principal curvature of each patch at its sample, without sign.

    Its unit is one over that of length. The patch's slope is neglected; a patch of degree 1 has curvature 0.
    """
    if patches.degree < 2:
        return np.zeros(len(patches.radii))
    columns = exponents(patches.degree)
    c20, c11, c02 = (patches.coefficients[:, columns.index(term)] for term in ((2, 0), (1, 1), (0, 2)))
    middle, half = c20 + c02, np.hypot(c20 - c02, c11)
    return (np.abs(middle) + half) / patches.radii


def patch_normals(patches: Patches) -> Floats:
    """Return (n, d) unit normals of the patches at their samples, of any sign; for estimates of the slope's error."""
    columns = exponents(patches.degree)
    first, second = (patches.coefficients[:, columns.index(term), None] for term in ((1, 0), (0, 1)))
    frames = patches.frames
    normals = frames[:, -1] - first * frames[:, 0] - (second * frames[:, 1] if frames.shape[1] == 3 else 0.0)
    return unit(normals)


def exponents(degree: int, variables: int = 2) -> list[tuple[int, int]]:
    """Return the exponents (i, j) of the monomials a^i b^j up to ``degree``, by i, then j; of one variable, j is 0."""
    return [(i, j) for i in range(degree + 1) for j in range(degree + 1 - i if variables == 2 else 1)]


def neighbourhoods(points: Floats, tree: cKDTree, count: int, normals: Floats | None, rows: Ints) -> Ints:
    """Return (m, count) the samples of ``rows`` (m,) themselves, then their neighbours, the nearest first.

    ``tree`` is that of ``points`` (n, d), ``count`` at most n. With ``normals`` (n, d), neighbours whose normal points
    the other way are passed over: they lie on another sheet. Where too few are left among :data:`CANDIDATE_FACTOR`
    times as many, the sample stands in for those that lack.
    """
    wanted = count if normals is None else min(CANDIDATE_FACTOR * count, len(points))
    found = np.empty((len(rows), count), dtype=np.int64)

    def find_neighbours(start: int, stop: int) -> None:
        samples = rows[start:stop]
        index = tree.query(points[samples], k=wanted)[1].reshape(stop - start, wanted)
        if normals is not None:
            same = np.einsum("nkd,nd->nk", normals[index], normals[samples]) > 0.0
            order = np.argsort(~same, axis=1, kind="stable")[:, :count]
            index, same = np.take_along_axis(index, order, axis=1), np.take_along_axis(same, order, axis=1)
            index = np.where(same, index, samples[:, None])
        found[start:stop] = index

    run_parcels(find_neighbours, len(rows), FITTED_PARCEL_SAMPLES)
    return found


def fit_patches(points: Floats, neighbours: Ints, degree: int, rows: Ints) -> Patches:
    """Return a patch of ``degree`` for each sample of ``rows`` (m,), fitted to its ``neighbours`` (m, k).

    Both are rows of ``points`` (n, d); the sample is among its neighbours. The m patches are in the order of ``rows``.
    Where the neighbours do not determine all coefficients, degree 1 is tried, and then degree 0: the plane through the
    sample parallel to that of the neighbours, a curve's line likewise.
    """
    n, dim = len(rows), points.shape[1]
    fitted = Patches(
        degree,
        neighbours.shape[1],
        np.empty((n, dim, dim)),
        np.empty(n),
        np.zeros((n, len(exponents(degree)))),
        np.empty(n),
        np.zeros(n, dtype=np.int64),
    )

    def fit(start: int, stop: int) -> None:
        _fit_parcel(points[neighbours[start:stop]] - points[rows[start:stop], None], degree, fitted, slice(start, stop))

    run_parcels(fit, n, FITTED_PARCEL_SAMPLES)
    return fitted


def _fit_parcel(offsets: Floats, degree: int, fitted: Patches, rows: slice) -> None:
    """Fit patches to ``offsets`` (m, k, d) from samples to neighbours; write the m ``rows`` of ``fitted`` in place.

    Coefficients that are not determined, and degrees there, keep their value, zero.
    """
    distances = np.linalg.norm(offsets, axis=2)
    radii = distances.max(axis=1)
    scaled = offsets / radii[:, None, None]
    weights = np.exp(-WEIGHT_DECAY * (distances / radii[:, None]) ** 2)
    centred = scaled - np.einsum("mk,mkd->md", weights, scaled)[:, None] / weights.sum(axis=1)[:, None, None]
    spread, axes = np.linalg.eigh(np.einsum("mk,mki,mkj->mij", weights, centred, centred))
    frames = np.swapaxes(axes, 1, 2)[:, ::-1]
    fitted.frames[rows], fitted.radii[rows] = frames, radii
    fitted.thickness[rows] = np.sqrt(np.maximum(spread[:, 0], 0.0) / np.maximum(spread[:, 1], np.finfo(float).tiny))
    local = np.einsum("mij,mkj->mki", frames, scaled)
    coefficients, degrees = fitted.coefficients[rows], fitted.degrees[rows]
    columns = exponents(degree)
    left = np.arange(len(local))
    for lower in sorted({degree, 1}, reverse=True):
        terms = exponents(lower, offsets.shape[2] - 1)
        solved, found = _solve_least_squares(local[left], np.sqrt(weights[left]), terms)
        done = left[found]
        coefficients[np.ix_(done, [columns.index(term) for term in terms])] = solved[found]
        degrees[done] = lower
        left = left[~found]
        if not len(left):
            return


def _solve_least_squares(local: Floats, weights: Floats, terms: Sequence[tuple[int, int]]) -> tuple[Floats, Bools]:
    """Return (m, terms) coefficients of height fields, and (m,) whether the neighbours determine them.

    Coefficients that are not determined are zero. ``local`` (m, k, d) are the neighbours in the frames, in units of the
    radii, ``weights`` (m, k) root weights, ``terms`` the exponents (i, j) of the monomials.
    """
    first, second = local[:, :, 0], local[:, :, local.shape[2] - 2]
    design = np.stack([first**i * second**j for i, j in terms], axis=2) * weights[:, :, None]
    heights = local[:, :, -1] * weights
    if design.shape[1] < design.shape[2]:
        return np.zeros((len(local), len(terms))), np.zeros(len(local), dtype=np.bool_)
    u, singular, vt = np.linalg.svd(design, full_matrices=False)
    found = singular[:, -1] > RANK_TOLERANCE * singular[:, 0]
    inverse = np.where(found[:, None], 1.0 / np.where(found[:, None], singular, 1.0), 0.0)
    solved = np.einsum("mts,mt->ms", vt, inverse * np.einsum("mks,mk->ms", u, heights))
    return solved, found
