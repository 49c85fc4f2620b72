"""Evaluation of a solution at points of the manifold, on either side of a boundary."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any
from weakref import WeakValueDictionary

import numpy as np

from cpmkit.errors import InputError
from cpmkit.forms.galerkin.conditions.boundary_sides import DIFFERENCE_SPACINGS, READ_INSIDE_WIDTHS, signed_distances
from cpmkit.forms.galerkin.patch_locator import PatchLocator
from cpmkit.forms.galerkin.scene_sampling import SampledScene
from cpmkit.forms.galerkin.sheet_separation import SheetSeparation
from cpmkit.forms.galerkin.space.function_space import FunctionSpace
from cpmkit.manifold.abilities import HasGivenMesh
from cpmkit.manifold.source import ClosestPoints
from cpmkit.manifold.tangent_space import outward_conormals, project_tangent
from cpmkit.mesh.adjacency import CellSides
from cpmkit.runtime.arrays import as_points
from cpmkit.runtime.memory import state_without_cached
from cpmkit.scene.boundary import Boundary, boundary_number, named_sides
from cpmkit.scene.diffusivities import evaluate_diffusivity
from cpmkit.scene.scene import Scene
from cpmkit.types import Floats, Ints, Side, Sides, SparseMatrix

#: Points farther from the manifold than so many spacings are refused: another part of it may be meant.
READING_SPACINGS = 3.0


@dataclass(frozen=True, eq=False)
class PointReader:
    """Evaluation of the functions of a space at points, whatever the equation and the conditions."""

    sampled: SampledScene  #: The manifold and its boundaries.
    space: FunctionSpace  #: The function space.

    __getstate__ = state_without_cached

    @property
    def boundaries(self) -> list[Boundary]:
        """The boundaries of the scene, by their numbers."""
        return [oriented.boundary for oriented in self.sampled.oriented]

    @property
    def points(self) -> Floats:
        """(p, d) the samples of the manifold in the scene's coordinates: a read-only array, released when unused."""
        points: Floats | None = self._weak_points.get("points")
        if points is None:
            points = self.sampled.samples.points_at(slice(self.sampled.interior))  # a new array
            points += self.sampled.lattice.origin
            points.flags.writeable = False
            self._weak_points["points"] = points
        return points

    @cached_property
    def _weak_points(self) -> WeakValueDictionary[str, Floats]:
        """The cache of :attr:`points`."""
        return WeakValueDictionary()

    @cached_property
    def locator(self) -> PatchLocator:
        """The search for the patch in which a point is evaluated."""
        sampled, boundary, count = self.sampled, self.sampled.boundary, len(self.sampled.half.cell)
        owner, left = np.full(count, -1), np.zeros(count, dtype=bool)
        rows = np.flatnonzero((boundary.half >= 0) & ~boundary.beyond_tip)
        owner[boundary.half[rows]], left[boundary.half[rows]] = boundary.owner[rows], sampled.left[rows]
        for number, oriented in enumerate(sampled.oriented):
            if not oriented.has_left:
                owner[owner == number] = -1
        places = sampled.mesh.vertices[sampled.mesh.cells].mean(axis=1)
        sides = CellSides(sampled.corners, places, self.space.spacing, sampled.half, owner, left)
        surface, sheets = sampled.surface, None
        if isinstance(surface.source, HasGivenMesh):
            vertices, cells = surface.source.given_mesh
            sheets = SheetSeparation(sampled.mesh, vertices - surface.shift, cells, self.space.spacing)
        parts = sampled.samples, self.space.dof_map, sides, sampled.oriented, sheets
        return PatchLocator(sampled.lattice, *parts, sampled.mesh)

    def evaluation_matrix(self, points: Any, side: Sides = None) -> SparseMatrix:
        """Return the matrix (k, n) that evaluates u at :meth:`closest_points` of ``points``, on :meth:`sides`."""
        feet, patch, cells = self._locate_points(points, side)
        return self.space.value_rows(patch, feet.points, cells)

    def _locate_points(self, points: Any, side: Sides) -> tuple[ClosestPoints, Ints, Ints]:
        """Return the :meth:`closest_points` of ``points``, and the patches and mesh cells (k,) to evaluate u there."""
        feet = self.closest_points(points)
        patch, nearest = self.locator.patches(feet, self.sides(side))
        return feet, patch, self.sampled.samples.cell_at(nearest)

    def closest_points(self, points: Any) -> ClosestPoints:
        """Return the closest points on the manifold to ``points`` (k, d), which are given in the scene's coordinates.

        The closest points are relative to the lattice's origin. Raises InputError if ``points`` have another shape, or
        one is not finite or is more than three spacings from the manifold.
        """
        at = as_points(points, self.sampled.lattice.dim)
        feet = self.sampled.surface.closest_point(self.sampled.lattice.to_local(at))
        worst, radius = float(feet.distance.max(initial=0.0)), READING_SPACINGS * self.space.spacing
        if worst > radius:
            raise InputError(
                f"points must lie within {READING_SPACINGS:g} spacings, {radius:.3g}, of the manifold to be read, "
                f"the farthest is {worst:.3g} away; take their closest points first."
            )
        return feet

    def sides(self, side: Sides) -> dict[int, Side]:
        """Return the side from which points of boundaries are read, by number; raises as :func:`named_sides`."""
        has_left = [oriented.has_left for oriented in self.sampled.oriented]
        by_name = named_sides(self.boundaries, side, has_left)
        return {boundary_number(self.boundaries, name): chosen for name, chosen in by_name.items()}

    def signed_distance(self, name: str, points: Any) -> Floats:
        """Return distances (k,) of ``points`` from a boundary: left positive; NaN past its ends or without a left."""
        number = boundary_number(self.boundaries, name)
        return signed_distances(self.sampled.oriented[number], self.closest_points(points).points, self.sampled.lattice)

    def gradient(self, u: Floats, points: Any, side: Sides = None) -> Floats:
        """Return the tangential gradient (k, channels, d) of u at the manifold's points nearest to ``points`` (k, d).

        The gradient of the splines is first projected onto the splines, which makes it 2 to 6 times more exact. The
        projection is cached for the last array ``u`` (n, channels). ``side`` is that of :func:`named_sides`.
        """
        space = self.space
        feet, patch, cells = self._locate_points(points, side)
        rows = space.value_rows(patch, feet.points, cells)
        if self._last_gradient.get("u") is not u:
            at_samples = space.spline_gradients_at_samples(u)
            self._last_gradient.update(u=u, projected=space.project(at_samples.reshape(len(at_samples), -1)))
        gradient = np.asarray(rows @ self._last_gradient["projected"]).reshape(-1, u.shape[1], space.dof_map.dim)
        further = [matrix @ u[space.spline_count :] for matrix in space.further_gradient_rows(feet.points, cells)]
        if further:
            gradient = gradient + np.stack(further, axis=-1)
        step = DIFFERENCE_SPACINGS * space.spacing
        surface = self.sampled.surface
        channels = [project_tangent(surface, feet, vectors, step) for vectors in gradient.transpose(1, 0, 2)]
        return np.stack(channels, axis=1) if channels else gradient

    @cached_property
    def _last_gradient(self) -> dict[str, Floats]:
        """The cache of :meth:`gradient`: the last u, and the unknowns of its projected gradient."""
        return {}

    def conormal_derivative(
        self, u: Floats, points: Any, boundary: str | None, side: Side | None, scene: Scene
    ) -> Floats:
        """Return du/db (k, channels), b outwards, at ``points`` (k, d) of a boundary's side, or of the manifold's edge.

        The edge is meant if ``boundary`` or ``side`` is None. Where the diffusivity A of the scene is a tensor, the
        derivative is along A b / (b . A b).
        """
        lattice, surface = self.sampled.lattice, self.sampled.surface
        at, step = as_points(points, lattice.dim), DIFFERENCE_SPACINGS * lattice.spacing
        if boundary is None or side is None:
            on_rim = surface.closest_point(lattice.to_local(at))
            where, b = lattice.to_scene(on_rim.points), outward_conormals(surface, on_rim, step)
            gradient = self.gradient(u, points)
        else:
            ((number, _),) = self.sides({boundary: side}).items()
            oriented = self.sampled.oriented[number]
            feet, on_boundary = oriented.feet(at - oriented.left.origin)
            where, leftward = on_boundary.points + oriented.left.origin, oriented.leftward(feet, on_boundary, step)
            b = -leftward if side == "left" else leftward
            gradient = self.gradient(u, where, {boundary: side})
        if scene.has_tensor:
            inside = where - READ_INSIDE_WIDTHS * self.space.spacing * b
            tensors = evaluate_diffusivity(scene.problem.terms().diffusivity, inside, "the diffusivity")
            along = np.einsum("kij,kj->ki", tensors, b)
            b = along / np.einsum("ki,ki->k", b, along)[:, None]
        return np.asarray(np.einsum("kcd,kd->kc", gradient, b))
