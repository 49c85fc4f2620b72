"""The finite-element form: values at nodes, evaluation at points, and warnings."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from cpmkit.plugin import (
    Bools,
    Data,
    Floats,
    InputError,
    Ints,
    Operator,
    Side,
    as_points,
    named_sides,
    small_boundary_warnings,
    warnings_of,
)
from cpmkit_fem.contacts import sides_of_jumps
from cpmkit_fem.equations import Equations
from cpmkit_fem.nearest import pin_warnings
from cpmkit_fem.reading import locate_on_curved_cells, reading_matrix
from cpmkit_fem.sides import locate_points
from cpmkit_fem.work import FemWork

if TYPE_CHECKING:
    from scipy.sparse import csr_array

    from cpmkit.plugin import DisplayMesh, SolveReport

#: A curve smaller than this share of a mean edge acts as one of about that size.
SMALL_EDGES = 1 / 3


@dataclass(frozen=True, eq=False)
class FiniteElements(Equations):
    """A scene on a mesh, with functions that are polynomials on each cell: unknowns are values at nodes."""

    # Values

    def at_points(self, u: Floats, rows: Ints | None = None) -> Floats:
        """Return the values (n, channels) at nodes, or at those in ``rows``, of the unknowns ``u``.

        Both are equal except at nodes whose unknown is a jump.
        """
        values = self.change_variables(u)
        return values if rows is None else values[rows]

    def project(self, values: Floats, start: Floats | None = None, time: float | None = None) -> Floats:
        """Return unknowns of ``values`` (n, channels) at nodes, with the values prescribed at ``time``.

        By default it is the start time of the problem; ``start`` is ignored.
        """
        del start
        return self._with_prescribed(values, self.pins.values(self.scene.problem.start_time if time is None else time))

    def interpolate(
        self, data: Data, label: str, time: float = 0.0, in_range: bool = False, step: float = 0.0
    ) -> Floats:
        """Return the unknowns (n, channels) of ``data`` at nodes and ``time``; at pinned nodes the prescribed values.

        With a ``step`` above 0 the latter are rates: differences over the step. ``label`` names the data in errors;
        ``in_range`` is ignored.
        """
        del in_range
        prescribed = self.pins.values(time)
        if step:
            prescribed = (self.pins.values(time + step) - prescribed) / step
        return self._with_prescribed(self.data_at_points(data, label, time, self.scene.channels), prescribed)

    def _with_prescribed(self, values: Floats, prescribed: Floats) -> Floats:
        """Return unknowns of ``values`` (n, channels) at nodes, with ``prescribed`` (p, channels) at pinned vertices.

        Where a jump is prescribed, both of its sides move in inverse proportion to their masses, so that the integral
        is kept.
        """
        u = self.change_variables(values).copy()
        left, right = sides_of_jumps(self.ties)
        before = u[right]
        u[self.pins.vertices] = prescribed
        if len(left):  # a new jump moves both sides in inverse proportion to their masses: the total heat is kept
            mass = np.asarray(self.mass_matrix.sum(axis=1)).ravel()
            u[left] += (mass[right] / (mass[left] + mass[right]))[:, None] * (u[right] - before)
        return u

    def inner(self, u: Floats, v: Floats) -> Floats:
        """Return the means (k, m) over the mesh of the products of the columns of ``u`` (n, k) and ``v`` (n, m)."""
        return np.asarray(
            self.change_variables(u).T @ (self.mass_matrix @ self.change_variables(v)) / self.mass_matrix.sum()
        )

    def evaluation_matrix(self, points: Floats, side: Side | Mapping[str, Side] | None = None) -> csr_array:
        """Return matrix (k, n) that evaluates u at the mesh's nearest points to ``points`` (k, d), on their own side.

        It multiplies the unknowns. On a boundary the side is ``side``, or by name of the boundary ``side[name]``, by
        default left; pinned boundaries have one value. Raise InputError if points have another shape or are not finite,
        or a side is neither left nor right of a boundary of the scene.
        """
        queries = as_points(points, self.scene.surface.dim)
        if self.mesh.curved:
            queries = self.scene.surface.closest_point(queries).points
        cell, local = locate_points(self.scene, self.mesh, self.cut, queries, named_sides(self.scene.boundaries, side))
        if self.mesh.curved:
            local = locate_on_curved_cells(self.mesh, cell, local, queries)
        rows = reading_matrix(self.mesh, cell, local)
        return rows if self.change is None else (rows @ self.change).tocsr()

    def flux(
        self,
        u: Floats,
        boundary: str | int,
        side: Side | None,
        time: float | None,
        where: Callable[[Floats], Bools] | None = None,
    ) -> Floats | None:
        """Raise InputError: fluxes are not computed."""
        del u, boundary, side, time, where
        raise InputError("the form 'fem' computes no fluxes; use backend='cpm', of a solid form='galerkin'.")

    # Diagnosis

    def warnings(self) -> tuple[str, ...]:
        """Return the warnings of the surface, of inserted boundaries or pins off them, and of boundaries too small."""
        of_boundaries = pin_warnings(self.rim) if self.cut is None else self.cut.warnings
        return (*warnings_of(self.scene.surface, self.spacing), *of_boundaries, *self._small_boundaries())

    def _small_boundaries(self) -> tuple[str, ...]:
        """Return warnings of values at points of a surface, and on curves far smaller than an edge; () on a curve."""
        if self.mesh.manifold_dim != 2:
            return ()
        cutting = [boundary.name for boundary in self.scene.boundaries if boundary.source.manifold_dim != 0]
        return small_boundary_warnings(self.scene, cutting, self.spacing, SMALL_EDGES * self.mesh.mean_edge)

    def work(self, operator: Operator, report: SolveReport | None) -> FemWork:
        """Return sizes of the mesh and of the matrix of ``operator``, and its applications, 0 without a ``report``."""
        free, done = self.size - len(self.pins.vertices), report.operator_applications if report else 0
        return FemWork(free, self.size, len(self.mesh.cells), operator.nonzeros, done)

    def describe(self) -> dict[str, Any]:
        """Return a record with the name of the form and the degree of its elements.

        The name is "fem-pinned" if boundaries are pinned, else "fem": without boundaries the two forms are one.
        """
        pinned = self.cut is None and bool(self.scene.boundaries)
        return {"backend": "fem-pinned" if pinned else "fem", "degree": self.mesh.degree}

    def display_mesh(self, u: Floats) -> DisplayMesh:
        """Return the mesh to draw, with the values of the unknowns ``u`` (n, channels) at its vertices."""
        from cpmkit.plugin import DisplayMesh, vertex_normals

        vertices, faces, values = self.vertices, self.faces, self.change_variables(u)
        if self.mesh.manifold_dim == 3:  # the vertices of the boundary alone
            used, faces = np.unique(faces, return_inverse=True)
            vertices, faces, values = vertices[used], faces.reshape(-1, 3), values[used]
        normals = vertex_normals(vertices, faces) if vertices.shape[1] == faces.shape[1] == 3 else None
        return DisplayMesh(vertices, faces, values, normals, len(vertices))
