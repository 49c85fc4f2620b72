"""Scenes solved by the rooms of the Galerkin form on meshes that tests make: sampled, parted, with their conditions."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse.linalg import splu

from cpmkit.forms.galerkin.conditions.boundary_samples import boundary_samples
from cpmkit.forms.galerkin.conditions.boundary_sides import left_of_boundaries
from cpmkit.forms.galerkin.conditions.condition_terms import ConditionTerms, condition_terms
from cpmkit.forms.galerkin.conditions.imposed_conditions import imposed_conditions, needs_rims
from cpmkit.forms.galerkin.dof_map import build_dof_map
from cpmkit.forms.galerkin.options import STABILISATIONS
from cpmkit.forms.galerkin.space.energy import load, stiffness_with_floor
from cpmkit.forms.galerkin.space.spline_space import build_spline_space, derivative_rows, value_rows
from cpmkit.grid.lattice import Lattice
from cpmkit.mesh.adjacency import cut_corners, half_facets
from cpmkit.mesh.cell_quadrature import Samples, quadrature
from cpmkit.mesh.subdivision import split_at_knot_planes
from cpmkit.plugin import Mesh, evaluate_data, localize


@dataclass
class Small:
    """A scene's matrices and loads, and rows that read u at the samples of the manifold."""

    scene: object
    samples: Samples
    conditions: ConditionTerms
    left: np.ndarray
    energy: object
    b: np.ndarray
    rows: object

    @property
    def matrix(self):
        return (self.energy + self.conditions.matrix).tocsc()

    def solved(self):
        """The values at the samples of the manifold, in their order."""
        u = splu(self.matrix).solve(self.b + self.conditions.load(self.scene.channels))
        return self.rows @ u

    def error(self, exact):
        """The largest error at the samples; ``exact`` takes points and the numbers of their cells."""
        return np.abs(self.solved()[:, 0] - exact(self.points, self.samples.cell)).max()

    @property
    def points(self):
        return self.conditions.lattice.to_scene(self.samples.points)

    def definite(self):
        """Whether no eigenvalue is at zero or below."""
        try:
            np.linalg.cholesky(self.matrix.toarray())
        except np.linalg.LinAlgError:
            return False
        return True


def small(scene, mesh, spacing, origin=None, points=None):
    """Discretise a scene on a mesh given in the scene's coordinates."""
    origin = np.zeros(mesh.dim) if origin is None else np.asarray(origin, dtype=float)
    lattice, surface = Lattice(origin, spacing), localize(scene.surface, origin)
    moved = None if mesh.midpoints is None else mesh.midpoints - origin
    mesh = replace(mesh, vertices=mesh.vertices - origin, midpoints=moved)
    half, corners, inner = half_facets(mesh), cut_corners(mesh), quadrature(mesh)
    border = boundary_samples(mesh, half, corners, needs_rims(scene), points)
    samples = Samples(
        *[np.concatenate([getattr(one, name) for one in (inner, border.as_samples)]) for name in vars(inner)]
    )
    dof_map = build_dof_map(samples.points, corners[samples.cell], spacing)
    space, q = build_spline_space(dof_map, samples), len(inner.points)
    rows = (
        value_rows(dof_map, dof_map.patch[q:], border.points),
        derivative_rows(dof_map, dof_map.patch[q:], border.points, border.conormals),
    )
    left = left_of_boundaries(mesh, half, corners, border, [scene.oriented(one) for one in scene.boundaries], lattice)
    laws, terms = imposed_conditions(scene, border, left, surface, lattice), scene.problem.terms()
    where = lattice.to_scene(np.concatenate([inner.points, border.points - 1e-6 * spacing * border.conormals]))
    a, c, f = (
        evaluate_data(data, where, k, "data")
        for data, k in zip((terms.diffusivity, terms.c, terms.f), (1, 1, scene.channels), strict=True)
    )
    areas, logarithms = load(space, np.concatenate([np.ones_like(a), np.log(a)], axis=1)).T
    data = terms.diffusivity, logarithms, lattice, None, np.array([spacing])
    conditions = condition_terms(laws, border, left, rows, areas, *data)
    return Small(
        scene,
        inner,
        conditions,
        left,
        stiffness_with_floor(space, a[:, 0], STABILISATIONS[2]["default"], c[:, 0]),
        load(space, f),
        value_rows(dof_map, dof_map.patch[:q], inner.points),
    )


def circle_mesh(spacing, cuts, origin=(0.0, 0.0), radius=1.0):
    """The circle by quadratic arcs that end on knot planes, cut at angles."""
    count = int(np.ceil(2 * np.pi * radius / (0.5 * spacing)))
    angles = np.unique(np.mod(np.concatenate([2 * np.pi * np.arange(count) / count, cuts]), 2 * np.pi))
    vertices = radius * np.stack([np.cos(angles), np.sin(angles)], axis=1) - origin
    number = np.arange(len(angles))
    cut = np.searchsorted(angles, np.mod(cuts, 2 * np.pi))[:, None]
    mesh = Mesh(
        vertices,
        np.stack([number, np.roll(number, -1)], axis=1),
        None,
        cut,
        np.arange(len(cut)),
        np.zeros(len(cut), dtype=bool),
    )
    mesh = split_at_knot_planes(mesh, spacing)
    on_circle = mesh.vertices + origin
    on_circle *= radius / np.linalg.norm(on_circle, axis=1, keepdims=True)
    middles = on_circle[mesh.cells].mean(axis=1)
    middles *= radius / np.linalg.norm(middles, axis=1, keepdims=True)
    return replace(mesh, vertices=on_circle, midpoints=middles[:, None])
