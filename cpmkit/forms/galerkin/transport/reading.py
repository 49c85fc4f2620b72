"""A velocity read at samples."""

from __future__ import annotations

import numpy as np

from cpmkit.errors import InputError
from cpmkit.forms.galerkin.conditions.boundary_samples import BoundarySamples
from cpmkit.grid.lattice import Lattice
from cpmkit.protocols import Floats
from cpmkit.scene.data import evaluate_data
from cpmkit.scene.equations import VectorField

#: At boundaries a velocity is read so far inside the cell, as a share of the way to its middle: it may jump there.
INSIDE_SHARE = 1e-6


def velocity_at(velocity: VectorField, points: Floats, normals: Floats, lattice: Lattice) -> Floats:
    """Return the tangential part (k, d) of a velocity at ``points`` (k, d) with ``normals`` (k, c, d).

    Raises
    ------
    InputError
        If it has another number of coordinates.
    """
    v = evaluate_data(velocity, lattice.to_scene(points), None, "the velocity")
    if v.shape[1] != points.shape[1]:
        raise InputError(f"the velocity must be vectors of shape (n, {points.shape[1]}), got (n, {v.shape[1]}).")
    along = np.einsum("qd,qcd->qc", v, normals)
    return np.asarray(v - np.einsum("qc,qcd->qd", along, normals))


def speed_out(velocity: VectorField, samples: BoundarySamples, lattice: Lattice) -> Floats:
    """Return v . b (b,) at boundary samples, b out of their cells."""
    points = samples.points + INSIDE_SHARE * (samples.centres - samples.points)
    return np.asarray(np.einsum("bd,bd->b", velocity_at(velocity, points, samples.normals, lattice), samples.conormals))
