"""Coefficients on the sides of boundaries: local widths, and the diffusivity, which may jump there."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from cpmkit.errors import InputError, SceneError, place
from cpmkit.forms.galerkin.conditions.boundary_samples import BoundarySamples
from cpmkit.forms.galerkin.space.energy import mean_over_tangents
from cpmkit.grid.lattice import Lattice
from cpmkit.scene.data import Data, evaluate_data
from cpmkit.scene.diffusivities import evaluate_diffusivity
from cpmkit.types import Bools, Floats

if TYPE_CHECKING:
    from scipy.sparse import csr_array


#: Area by length of what a sample reads, in spacings, where nothing else is near.
WIDE_SHARE = 0.89
#: Data are read so many widths inside their side, and twice as far: a curve that is snapped to the surface lies nearer
#: to where materials meet than that.
READ_BESIDE_WIDTHS = 0.25
#: Readings whose logarithms differ by less are of one material, and are continued to the boundary.
SAME_MATERIAL_LOG_RATIO = 0.4
#: Readings whose logarithm is farther than this from the zone's mean near by are of another zone: all of a sliver may
#: be, that a boundary cuts off beside an edge of the mesh.
OTHER_ZONE_LOG_RATIO = 2.0

#: What is given may differ from the problem's diffusivity by this share of it.
DIFFUSIVITY_MISMATCH_SHARE = 0.01
#: Share of a boundary's points that may be misread, where it meets other boundaries.
MISREAD_POINTS_SHARE = 0.1


def local_widths(
    values: csr_array, areas: Floats, samples: BoundarySamples, sides: Sequence[Bools], spacing: Floats
) -> Floats:
    """Return how wide the manifold is beside boundary samples (b,), h at most: penalties are in units of its inverse.

    ``w(y) = min(h, (sum_j N_j(y) A_j / sum_j N_j(y) L_j) / .89)``, A_j and L_j the integrals of spline j over the
    manifold and over its side of the boundary.

    Parameters
    ----------
    values : csr_array (b, n)
        The splines N_j at the samples.
    areas : (n,) float64
        A_j.
    samples : BoundarySamples
        Where they are.
    sides : sequence of (b,) bool
        Those that are measured together, as on one side of a boundary, none twice; elsewhere the width is h.
    spacing : (b,) float64
        h there.
    """
    width, measured = np.array(spacing, dtype=np.float64), np.stack(sides, axis=1) & (samples.half >= 0)[:, None]
    lengths = values @ (values.T @ np.where(measured, samples.weights[:, None], 0.0))
    row, side = np.nonzero(measured)
    width[row] = np.minimum(width[row], (values @ areas)[row] / lengths[row, side] / WIDE_SHARE)
    return width


def one_sided_value(
    data: Data, samples: BoundarySamples, widths: Floats, around: Floats, lattice: Lattice, what: str
) -> Floats:
    """Return a positive coefficient (b,) at boundary samples, on the side of their cells.

    On rims it is read as it is, and where it is smooth from side to side: where its third difference is below its
    second one, so that a jump would be a smaller error than continuing it from one side. Elsewhere it is read twice
    along the conormal, and twice towards the middle of the cell, and continued to the sample. The first readings may
    lie in another zone, where boundaries meet, the second beyond where materials change, where a boundary is off that:
    those are taken that fit the zone's mean.

    Parameters
    ----------
    data : Data
        The coefficient.
    samples : BoundarySamples
        Where it is read.
    widths : (b,) float64
        How wide the manifold is there.
    around : (b,) float64
        The mean of the logarithm of the coefficient over the zone near by.
    lattice, what
        That coordinates are relative to, and what the data are, in sentences.

    Raises
    ------
    InputError
        If it is not a positive number everywhere.
    """
    if not callable(data):
        return _positive_values(data, samples.points, lattice, what)
    return one_sided_readings(data, samples, widths, around, lattice, what)[0]


def inward_steps(samples: BoundarySamples, widths: Floats) -> tuple[Floats, Floats]:
    """Return the steps (b, d) by which data are read beside a boundary: along the conormal, and into the cell."""
    return -READ_BESIDE_WIDTHS * widths[:, None] * samples.conormals, 0.5 * (samples.centres - samples.points)


def one_sided_readings(
    data: Data, samples: BoundarySamples, widths: Floats, around: Floats, lattice: Lattice, what: str
) -> tuple[Floats, Bools]:
    """Return the same for a function of points, and where (b,) it was read along the conormal or at the samples."""

    def logarithm(step: Floats | float) -> Floats:
        return np.asarray(np.log(_positive_values(data, samples.points + step, lattice, what)))

    along, into = inward_steps(samples, widths)
    here, pairs = logarithm(0.0), [(logarithm(step), logarithm(2 * step)) for step in (along, into)]
    found = [np.where(np.abs(near - far) < SAME_MATERIAL_LOG_RATIO, 2 * near - far, np.inf) for near, far in pairs]
    off = [np.abs(one - around) for one in found]
    by_conormal = off[0] <= off[1] + SAME_MATERIAL_LOG_RATIO
    value = np.where(by_conormal, *found)
    value = np.where(np.abs(value - around) < OTHER_ZONE_LOG_RATIO, value, around)
    rim = samples.owner < 0  # nothing is beyond
    (near, far), beyond = pairs[0], logarithm(np.where(rim[:, None], 0.0, -along))
    smooth = np.abs(far - 3 * near + 3 * here - beyond) <= np.abs(far - 2 * near + here)
    smooth = rim | (smooth & (np.abs(here - around) < OTHER_ZONE_LOG_RATIO))
    return np.exp(np.where(smooth, here, value)), smooth | by_conormal


def prescribed_conductivity(
    own: Data | None, a: Floats, samples: BoundarySamples, widths: Floats, lattice: Lattice, what: str, side: str
) -> Floats:
    """Return the conductivity (k,) that a condition gives on one side, ``a`` (k,), that of the problem, if it is None.

    Raises
    ------
    SceneError
        If it is not that of the problem.
    """
    if own is None:
        return a
    wanted = one_sided_value(own, samples, widths, np.log(a), lattice, f"a conductivity of {what}")
    off = np.abs(wanted / a - 1)
    if np.mean(off > DIFFUSIVITY_MISMATCH_SHARE) > MISREAD_POINTS_SHARE:
        worst = int(off.argmax())
        where = place(lattice.to_scene(samples.points[[worst]])[0])
        raise SceneError(
            f"{what} gives the conductivity {wanted[worst]:.4g} on its {side} near {where}, where the problem's "
            f"diffusivity is {a[worst]:.4g}; leave `{side}` out, or give the problem that diffusivity."
        )
    return wanted


def _positive_values(data: Data, points: Floats, lattice: Lattice, what: str) -> Floats:
    values = evaluate_data(data, lattice.to_scene(points), 1, what)[:, 0]
    if np.any(values <= 0):
        raise InputError(f"{what} must be above zero, got {values.min():g}.")
    return values


@dataclass(frozen=True, eq=False)
class ConormalFlux:
    """What a tensor makes of conormals.

    Attributes
    ----------
    a : (b,) float64
        s, and at points of a surface, which have no conormal, the mean over tangents.
    directions : (b, d) float64
        A b / s, tangent to the manifold.
    """

    a: Floats
    directions: Floats


def conormal_flux(
    tensors: Callable[[Floats], Floats], samples: BoundarySamples, widths: Floats, around: Floats, lattice: Lattice
) -> ConormalFlux:
    """Return how a tensor conducts at boundary samples, on the side of their cells.

    The mean over tangents is read as a number is; what the tensor is in units of it, at the same two places, and
    continued to the boundary, where it is definite there.

    Parameters
    ----------
    tensors : callable
        Of (b, d) points beside the samples, in the scene's coordinates: returns (b, d, d), or an array (d, d).
    samples, widths, around, lattice
        As of :func:`cpmkit.forms.galerkin.conditions.boundary_coefficients.one_sided_value`.
    """

    def read(points: Floats) -> Floats:
        return evaluate_diffusivity(tensors, points, "the diffusivity")

    def mean(points: Floats) -> Floats:
        return mean_over_tangents(read(points), samples.normals)

    value, along = one_sided_readings(mean, samples, widths, around, lattice, "the diffusivity")
    step = np.where(along[:, None], *inward_steps(samples, widths))
    places = [lattice.to_scene(samples.points + k * step) for k in (1, 2)]
    near, far = (read(at) / mean(at)[:, None, None] for at in places)
    b, continued = samples.conormals, 2 * near - far
    definite = np.einsum("bi,bij,bj->b", b, continued, b) > 0.5 * np.einsum("bi,bij,bj->b", b, near, b)
    shape = np.where(definite[:, None, None], continued, near)
    through = np.einsum("bij,bj->bi", shape, b)
    across = np.einsum("bci,bi->bc", samples.normals, through)
    through -= np.einsum("bci,bc->bi", samples.normals, across)
    share = np.einsum("bi,bi->b", b, through)
    out = share > 0
    share = np.where(out, share, 1.0)
    return ConormalFlux(value * share, through / share[:, None])
