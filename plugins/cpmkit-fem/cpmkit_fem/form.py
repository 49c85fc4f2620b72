"""A scene on the vertices of a triangulation: what linear finite elements answer to the families of equations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from cpmkit.plugin import (
    Border,
    CsrOperator,
    CutMesh,
    Data,
    Discretized,
    Floats,
    InputError,
    Ints,
    Mixed,
    Nonlinear,
    Operator,
    Scene,
    SceneError,
    Side,
    Spectral,
    StateFlux,
    Stiffness,
    Terms,
    Value,
    as_points,
)
from cpmkit_fem.assembly import lumped, stiffness_and_mass
from cpmkit_fem.nearest import pinned_vertices, warnings_of
from cpmkit_fem.operator import VertexOperator, pinned_operator, without
from cpmkit_fem.pins import Pins, pins_of
from cpmkit_fem.rim import RimPart, rim_of
from cpmkit_fem.sides import located, sides_of
from cpmkit_fem.ties import Tie, ties_of
from cpmkit_fem.triangulation import Triangulation

if TYPE_CHECKING:
    from scipy.sparse import csr_array

    from cpmkit.plugin import DisplayMesh, SolveReport

#: Data are asked for vertices on boundaries so far from their feet there, towards the middle of their triangles.
INWARD_SHARE = 1e-4


@dataclass(frozen=True)
class FemWork:
    """Machine-independent measures of a solve.

    Attributes
    ----------
    unknowns : int
        Vertices that nothing pins.
    vertices, faces : int
        Of the triangulation.
    nonzeros : int
        Stored entries of the matrix.
    operator_applications : int
        Products with it.
    """

    unknowns: int
    vertices: int
    faces: int
    nonzeros: int
    operator_applications: int

    def as_dict(self) -> dict[str, Any]:
        """Return the measures as plain values."""
        return asdict(self)


@dataclass(frozen=True, eq=False)
class FiniteElements(Discretized):
    """A scene on a triangulation, with functions that are linear on each triangle: unknowns are values at vertices.

    Attributes
    ----------
    scene : Scene
        What is discretised.
    mesh : Triangulation
        Of the surface.
    cut : CutMesh or None
        What lies on boundaries; None where there are none, or vertices near them are pinned.
    rim : sequence of RimPart
        Its rim and the sides of boundaries, by condition.
    ties : sequence of Tie
        The boundaries that couple their sides.
    pins : Pins
        The vertices whose values are given.
    laplacian, mass_matrix : csr_array (v, v)
        The integrals of grad u . grad v and of u v.
    """

    scene: Scene
    mesh: Triangulation
    cut: CutMesh | None
    rim: Sequence[RimPart]
    ties: Sequence[Tie]
    pins: Pins
    laplacian: csr_array
    mass_matrix: csr_array

    form: ClassVar[str] = "fem"
    libraries: ClassVar[tuple[str, ...]] = ("cpmkit", "cpmkit-fem", "scikit-fem", "numpy", "scipy")
    cannot: ClassVar[Mapping[str, str]] = {
        "second Laplacian": "use backend='cpm'",
        "diffusivity that is a tensor": "use backend='cpm'",
        "diffusivity that depends on u": "use backend='cpm'",
        "explicit steps": "use scheme 'newmark' or 'implicit', or backend='cpm'",
    }
    #: Factors of a matrix of triangles are sparse enough for every mesh.
    factorise_up_to: ClassVar[float] = np.inf

    @property
    def vertices(self) -> Floats:
        """(v, d) the vertices of the triangulation."""
        return self.mesh.vertices

    @property
    def faces(self) -> Ints:
        """(m, 3) its triangles."""
        return self.mesh.faces

    @property
    def size(self) -> int:
        """Number of vertices."""
        return len(self.vertices)

    @cached_property
    def spacing(self) -> float:
        """The mean length of a triangle's side."""
        corners = self.vertices[self.faces]
        return float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).mean())

    @cached_property
    def points(self) -> Floats:
        """(v, d) the vertices; on boundaries a little on their own side, for data that differ on the two."""
        if self.cut is None or not len(self.cut.edges):
            return self.vertices
        on, count = np.unique(self.cut.edges), np.bincount(self.faces.ravel(), minlength=self.size)
        centres = np.repeat(self.vertices[self.faces].mean(axis=1), 3, axis=0)
        total = np.stack([np.bincount(self.faces.ravel(), one, minlength=self.size) for one in centres.T], axis=1)
        points = self.vertices.copy()
        for number, boundary in enumerate(self.scene.boundaries):
            own = np.unique(self.cut.edges[self.cut.owner == number])
            if len(own):
                points[own] = boundary.source.closest_point(points[own]).points
        points[on] += INWARD_SHARE * (total[on] / count[on, None] - self.vertices[on])
        return points

    def restated(self, scene: Scene) -> FiniteElements:
        """Return the same triangulation and matrices with another scene, whose conditions have other data at most."""
        pairs = zip(scene.boundaries, self.scene.boundaries, strict=True)
        if scene.edge is self.scene.edge and all(first is second for first, second in pairs):
            return replace(self, scene=scene, pins=replace(self.pins, channels=scene.channels))
        rim = conditions_of(scene, self.mesh, self.cut)
        ties = ties_of(scene, self.mesh, self.cut)
        return replace(self, scene=scene, rim=rim, ties=ties, pins=pins_of(rim, scene.channels))

    # Equations

    @cached_property
    def mass(self) -> CsrOperator:
        """M, with no rows at pinned vertices, and columns there only where data, and so their values, move in time."""
        moves = self.data_move
        return CsrOperator(without(self.mass_matrix, self.pins.vertices, columns=not moves), symmetric=not moves)

    def stiffness(self, terms: Terms) -> VertexOperator:
        """Return A, the integrals of a grad u . grad v + c u v, and over the rim of a beta / alpha u v.

        Raises
        ------
        SceneError
            If there is a velocity.
        InputError
            If a diffusivity is not above zero.
        """
        if terms.velocity is not None:
            kind = self.scene.problem.kind
            raise SceneError(f"backend='fem' takes no velocity, got the kind {kind!r} with one; use backend='cpm'.")
        a, c = (self.read(*one)[:, 0] for one in ((terms.diffusivity, "the diffusivity"), (terms.c, "the factor c")))
        if np.any(a <= 0):
            raise InputError(f"the diffusivity must be above zero, got {a.min():g}.")
        matrix, mass = a[0] * self.laplacian, c[0] * self.mass_matrix
        if callable(terms.diffusivity) or callable(terms.c):
            matrix, mass = stiffness_and_mass(self.vertices, self.faces, a, c)
        matrix = (matrix + (lumped(mass) if terms.lumped else mass)).tocsr()
        for tie in self.ties:
            matrix = (matrix + tie.stiffness(a)).tocsr()
        rims = [part.mass(a / part.law.alpha) for part in self._flows]
        for part in self._flows:
            if isinstance(part.law, Mixed):
                beta = part.given(part.law.beta, 1, None)[:, 0]
                matrix = (matrix + part.mass(a * beta / part.law.alpha)).tocsr()
        fixed = not callable(terms.c) and bool(terms.c)
        return pinned_operator(matrix, self.pins.vertices, rims, fixed, a)

    @property
    def _flows(self) -> list[RimPart]:
        """The parts on which du/db is in the law."""
        return [part for part in self.rim if not isinstance(part.law, Value)]

    def load(self, f: Data, time: float | None = None) -> Floats:
        """Return the integrals of f v, f linear between the vertices; none at pinned vertices."""
        b = np.asarray(self.mass_matrix @ self.read(f, "the right-hand side f", time, self.channels))
        b[self.pins.vertices] = 0.0
        return b

    def data(self, stiffness: Stiffness, time: float | None = None, of: str = "value") -> Floats:
        """Return the integrals of the fluxes' data over the rim, and what the given values add to b."""
        del of  # a second Laplacian is refused
        assert isinstance(stiffness, VertexOperator)
        b = np.zeros((self.size, self.channels))
        for part, rim in zip(self._flows, stiffness.rims, strict=True):
            b += rim @ part.given(part.law.datum, self.channels, time)
        for tie in self.ties:
            b += tie.load(stiffness.diffusivity, self.channels, time)
        b[self.pins.vertices] = 0.0
        return np.asarray(b - stiffness.coupling @ self.pins.values(time))

    def boundary_mass(self, stiffness: Stiffness) -> CsrOperator | None:
        """Return the integrals of a u v over the parts of the rim where du/db = lambda u; None where there are none."""
        assert isinstance(stiffness, VertexOperator)
        pairs = zip(self._flows, stiffness.rims, strict=True)
        spectral = [rim for part, rim in pairs if isinstance(part.law, Spectral)]
        if not spectral:
            return None
        return CsrOperator(without(sum(spectral[1:], spectral[0]), self.pins.vertices, columns=True), symmetric=True)

    def free_constants(self, stiffness: Stiffness) -> Border | None:
        """Return the pieces on which a constant is free, with means over them; None where there is none."""
        assert isinstance(stiffness, VertexOperator)
        return None if stiffness.fixed else super().free_constants(stiffness)

    # Values

    def at_points(self, u: Floats) -> Floats:
        """Return u: unknowns are values at vertices."""
        return u

    def put_back(self, values: Floats) -> Floats:
        """Return the values, with those that are given where they are."""
        return self._with_given(values, self.pins.values(self.scene.problem.start_time))

    def with_values(self, u: Floats, values: Floats, time: float) -> Floats:
        """Return ``values``, with those that are given at ``time`` where they are."""
        del u
        return self._with_given(values, self.pins.values(time))

    def interpolate(self, data: Data, what: str, time: float = 0.0) -> Floats:
        """Return ``data`` at the vertices, with those that are given where they are."""
        return self._with_given(self.read(data, what, time, self.channels), self.pins.values(time))

    def interpolate_rate(self, data: Data, what: str, step: float) -> Floats:
        """Return the rates at the vertices, at pinned ones those of their values over the first step."""
        start = self.scene.problem.start_time or 0.0
        rates = (self.pins.values(start + step) - self.pins.values(start)) / step
        return self._with_given(self.read(data, what, start, self.channels), rates)

    def _with_given(self, values: Floats, given: Floats) -> Floats:
        values = values.copy()
        values[self.pins.vertices] = given
        return values

    def inner(self, u: Floats, v: Floats) -> Floats:
        """Return the means (k, m) over the triangulation of the products of u's columns with v's."""
        return np.asarray(u.T @ (self.mass_matrix @ v) / self.mass_matrix.sum())

    def rows(self, points: Floats, side: Side | Mapping[str, Side] | None = None) -> csr_array:
        """Return the matrix (k, v) that reads u at the nearest points of the triangulation, on the points' own side.

        Of points on a boundary it is the left one unless ``side`` says so.

        Raises
        ------
        InputError
            If a point is not finite, or a side is neither left nor right of a boundary of the scene.
        """
        from scipy.sparse import csr_array

        queries = as_points(points, self.scene.surface.dim)
        face, local = located(self.scene, self.mesh, self.cut, queries, self.sides(side))
        starts = 3 * np.arange(len(queries) + 1)
        return csr_array((local.ravel(), self.faces[face].ravel(), starts), shape=(len(queries), self.size))

    # Fluxes that depend on the solution

    @property
    def state_fluxes(self) -> Sequence[StateFlux]:
        """The parts whose flux depends on the solution."""
        return [part for part in self.rim if isinstance(part.law, Nonlinear)]

    def linearized(self, seen: Sequence[Floats]) -> FiniteElements:
        """Return the form with the fluxes' tangents."""
        values = iter(seen)
        rim = [part.linearized(next(values)) if isinstance(part.law, Nonlinear) else part for part in self.rim]
        return replace(self, rim=rim)

    # Telling

    def warnings(self, missed: float = 0.0) -> tuple[str, ...]:
        """Return how boundaries came into the mesh, or how far from them vertices are pinned."""
        del missed
        return warnings_of(self.rim) if self.cut is None else self.cut.told

    def work(self, operator: Operator, report: SolveReport | None) -> FemWork:
        """Return what the triangulation holds and what the solve did."""
        free, done = self.size - len(self.pins.vertices), report.operator_applications if report else 0
        return FemWork(free, self.size, len(self.faces), operator.nonzeros, done)

    def describe(self) -> dict[str, Any]:
        """Return that these are finite elements, and their degree."""
        pinned = self.cut is None and bool(self.scene.boundaries)
        return {"backend": "fem-pinned" if pinned else "fem", "degree": 1}

    def display_mesh(self, u: Floats) -> DisplayMesh:
        """Return the triangulation with u at its vertices."""
        from cpmkit.plugin import DisplayMesh, vertex_normals

        normals = vertex_normals(self.vertices, self.faces) if self.scene.surface.dim == 3 else None
        return DisplayMesh(self.vertices, self.faces, u, normals, self.size)


def conditions_of(scene: Scene, mesh: Triangulation, cut: CutMesh | None) -> Sequence[RimPart]:
    """Return the parts of the rim and the sides of boundaries, each with its law."""
    if cut is None:
        return [*pinned_vertices(scene, mesh), *rim_of(scene, mesh, np.zeros((0, 2), dtype=np.int64))]
    return [*sides_of(scene, mesh, cut), *rim_of(scene, mesh, cut.edges)]
