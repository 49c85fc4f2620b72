"""Systems of the Galerkin form on spheres, closed, two side by side, and with a circle held by a penalty."""

import numpy as np
from galerkin_scenes import sphere, together
from scipy.sparse import csr_array

from cpmkit.forms.galerkin.options import STABILISATIONS
from cpmkit.forms.galerkin.space.energy import add_ghosts, energy_data, mass, stiffness_with_floor
from cpmkit.forms.galerkin.space.spline_space import value_rows
from cpmkit.plugin import CsrOperator

ORIGIN = np.zeros(3)


def sphere_space(h, radius=1.0, shift=ORIGIN):
    return sphere(0.55 * h, radius).moved(shift).space(h)


def two_spheres(h, gap=0.3):
    """Two spheres that are ``gap`` spacings apart."""
    one = sphere(0.55 * h)
    return together(one, one.moved(np.array([2.0 + gap * h, 0.0, 0.0]))).space(h)


def stiffness(space, a, stabilisation):
    """The matrix of the energy with its stabilisation, without the floor."""
    data = energy_data(space, a, None, stabilisation)
    add_ghosts(space, a, stabilisation, data)
    return space.matrix(data)


def stiffness_of(space, c=None):
    """The operator of -Lap u, or of -Lap u + c u."""
    return CsrOperator(stiffness_with_floor(space, 1.0, STABILISATIONS[2]["default"], c), symmetric=True)


def mass_of(space):
    return CsrOperator(mass(space, 1.0), symmetric=True)


def circle_beside(space, height, strength=40.0):
    """The patches that a circle of latitude of the unit sphere lies in, and the matrix of a penalty on it."""
    dof_map, h = space.dof_map, space.dof_map.spacing
    radius = np.sqrt(1 - height**2)
    turns = 2 * np.pi * (np.arange(count := int(np.ceil(8 * np.pi * radius / h))) + 0.5) / count
    points = np.stack([radius * np.cos(turns), radius * np.sin(turns), np.full(count, height)], axis=1)
    cells = np.floor(points / h + 0.5).astype(np.int64)
    codes = [np.ravel_multi_index(tuple((each + 2**16).T), (2**17,) * 3) for each in (dof_map.cells, cells)]
    order = np.argsort(codes[0])
    patch = order[np.minimum(np.searchsorted(codes[0][order], codes[1]), len(order) - 1)]
    there = codes[0][patch] == codes[1]
    rows = value_rows(dof_map, patch[there], points[there])
    weight = strength / h * 2 * np.pi * radius / count
    return np.unique(patch), csr_array(weight * (rows.T @ rows))
