"""Tensors beside boundaries: how well they conduct out of a cell, and along what the slope of u is read.

What flows out is b . A grad u. With s = b . A b and the direction A b / s, whose part along b is 1, it is s times the
derivative of u along that: all conditions hold as they stand with s for the diffusivity and that derivative for du/db.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cpmkit.forms.galerkin.conditions.boundary_samples import BoundarySamples
from cpmkit.forms.galerkin.conditions.coefficients import inward_steps, readings
from cpmkit.forms.galerkin.space.energy import mean_over_tangents
from cpmkit.grid.lattice import Lattice
from cpmkit.protocols import Floats
from cpmkit.scene.diffusivities import evaluate_diffusivity


@dataclass(frozen=True, eq=False)
class Slants:
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


def slants(
    tensors: Callable[[Floats], Floats], samples: BoundarySamples, widths: Floats, around: Floats, lattice: Lattice
) -> Slants:
    """Return how a tensor conducts at boundary samples, on the side of their cells.

    The mean over tangents is read as a number is; what the tensor is in units of it, at the same two places, and
    continued to the boundary, where it is definite there.

    Parameters
    ----------
    tensors : callable
        Of (b, d) points beside the samples, in the scene's coordinates: returns (b, d, d), or an array (d, d).
    samples, widths, around, lattice
        As of :func:`cpmkit.forms.galerkin.conditions.coefficients.beside`.
    """

    def read(points: Floats) -> Floats:
        return evaluate_diffusivity(tensors, points, "the diffusivity")

    def mean(points: Floats) -> Floats:
        return mean_over_tangents(read(points), samples.normals)

    value, along = readings(mean, samples, widths, around, lattice, "the diffusivity")
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
    return Slants(value * share, through / share[:, None])
