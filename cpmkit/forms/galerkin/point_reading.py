"""Reading a solution at points of the manifold, from either side of a boundary."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from cpmkit.errors import InputError, shown
from cpmkit.forms.contract import Discretized
from cpmkit.forms.galerkin.conditions.boundary_coefficients import READ_BESIDE_WIDTHS
from cpmkit.forms.galerkin.enrichment.enriched_space import Enrichment
from cpmkit.forms.galerkin.options import GalerkinOptions
from cpmkit.forms.galerkin.patch_locator import DIFFERENCE_SPACINGS, CellSides, PatchLocator
from cpmkit.forms.galerkin.scene_sampling import SampledScene
from cpmkit.forms.galerkin.shared import cached_on_space
from cpmkit.forms.galerkin.sheet_separation import SheetSeparation
from cpmkit.forms.galerkin.space.spline_space import SplineSpace
from cpmkit.forms.galerkin.space.splines import derivative_rows, value_rows
from cpmkit.forms.options import Options
from cpmkit.manifold.source import ClosestPoints
from cpmkit.manifold.tangent_space import outward_conormals
from cpmkit.runtime.arrays import as_points
from cpmkit.runtime.caches import WeakCache
from cpmkit.scene.diffusivities import evaluate_diffusivity
from cpmkit.scene.scene import Scene
from cpmkit.types import SIDES, Floats, Ints, Side

if TYPE_CHECKING:
    from scipy.sparse import csr_array

#: Points farther from the manifold than so many spacings are not read: they may belong to another part of it.
READING_SPACINGS = 3.0
#: Points that are read at a time.
READ_AT_ONCE = 1 << 17


@dataclass(frozen=True, eq=False)
class Reader(Discretized):
    """The part of the form that reads values at points."""

    scene: Scene
    options: Options[GalerkinOptions]
    sampled: SampledScene
    space: SplineSpace
    shared: dict[str, Any] = field(default_factory=dict, kw_only=True, repr=False)

    @property
    def spacing(self) -> float:
        """Spacing of the lattice, in the scene's unit."""
        return self.sampled.lattice.spacing

    @cached_on_space
    def _tips(self) -> Enrichment:
        return Enrichment(self.sampled.singular, self.space, self.sampled.interior)

    @property
    def points(self) -> Floats:
        """(p, d) the samples of the manifold: one read-only array, which lives as long as it is referred to."""
        return self._points_in_use.get(self._fixed_points)

    @property
    def points_in_use(self) -> Floats:
        """(p, d) the same, for functionals of the scene."""
        return self.points

    @cached_on_space
    def _points_in_use(self) -> WeakCache[Floats]:
        return WeakCache()

    def _fixed_points(self) -> Floats:
        points = self.sampled.samples.points_at(slice(self.sampled.interior))  # fixed ones: nobody else's
        points += self.sampled.lattice.origin
        points.flags.writeable = False
        return points

    @cached_on_space
    def _locator(self) -> PatchLocator:
        one, count = self.sampled, len(self.sampled.half.cell)
        owner, left = np.full(count, -1), np.zeros(count, dtype=bool)
        on = np.flatnonzero((one.boundary.half >= 0) & ~one.boundary.beyond_tip)
        owner[one.boundary.half[on]], left[one.boundary.half[on]] = one.boundary.owner[on], one.left[on]
        for number, oriented in enumerate(one.oriented):
            if not oriented.has_left:
                owner[owner == number] = -1
        places = one.mesh.vertices[one.mesh.cells].mean(axis=1)
        sides = CellSides(one.corners, places, self.spacing, one.half, owner, left)
        sheets = SheetSeparation(one.mesh, one.geometry, one.surface, self.spacing)
        return PatchLocator(one.lattice, one.samples, self.space.dof_map, sides, one.oriented, sheets)

    def evaluate(
        self, u: Floats, points: Any, side: Side | Mapping[str, Side] | None = None, time: float | None = None
    ) -> Floats:
        """Return the values (k, channels) at the manifold's points nearest to ``points`` (k, d)."""
        del time
        at = as_points(points, self.scene.surface.dim)
        parts = [at[start : start + READ_AT_ONCE] for start in range(0, len(at), READ_AT_ONCE)]
        read = [np.asarray(self.rows(part, side) @ u) for part in parts]
        return np.concatenate(read) if read else np.zeros((0, u.shape[1]))

    def rows(self, points: Any, side: Side | Mapping[str, Side] | None = None) -> csr_array:
        """Return the matrix (k, n) that reads u at the manifold's points nearest to ``points`` (k, d)."""
        return self.reading_rows(points, side)[0]

    def reading_rows(
        self, points: Any, side: Side | Mapping[str, Side] | None
    ) -> tuple[csr_array, ClosestPoints, Ints]:
        """Return the same, the feet (k,) at which it reads, and the cells (k,) of the samples that led there."""
        from scipy.sparse import hstack

        feet = self._feet(points)
        patch, nearest = self._locator.patches(feet, self._numbered(side))
        cells, rows = self.sampled.samples.cell_at(nearest), self._value_rows(patch, feet.points)
        if len(self._tips):
            rows = hstack([rows, self._tips.values(feet.points, cells)], format="csr")
        return rows, feet, cells

    def _value_rows(self, patch: Ints, points: Floats) -> csr_array:
        """Return (k, n) the rows that read splines at ``points`` (k, d) through the ``patch`` (k,) of each."""
        return value_rows(self.space.dof_map, patch, points)

    def _derivative_rows(self, patch: Ints, points: Floats, directions: Floats) -> csr_array:
        """Return (k, n) the rows that read their derivatives along ``directions`` (k, d)."""
        return derivative_rows(self.space.dof_map, patch, points, directions)

    def _feet_points(self, points: Any) -> Floats:
        """Return the feet (k, d) of points near the manifold, relative to the lattice's origin.

        Raises
        ------
        InputError
            If a point is farther away than three spacings.
        """
        return self._feet(points).points

    def _feet(self, points: Any) -> ClosestPoints:
        local = self.sampled.lattice.to_local(as_points(points, self.scene.surface.dim))
        feet = self.sampled.surface.closest_point(local)
        worst, radius = float(feet.distance.max(initial=0.0)), READING_SPACINGS * self.spacing
        if worst > radius:
            raise InputError(
                f"points must lie within {READING_SPACINGS:g} spacings, {radius:.3g}, of the manifold to be read, "
                f"the farthest is {worst:.3g} away; take their closest points first."
            )
        return feet

    def _numbered(self, side: Side | Mapping[str, Side] | None) -> dict[int, Side]:
        names = [boundary.name for boundary in self.scene.boundaries]
        return {names.index(name): one for name, one in self.sides(side).items()}

    def sides(self, side: Side | Mapping[str, Side] | None) -> Mapping[str, Side]:
        """Return the side that is asked for, by the name of each boundary that has sides.

        Raises
        ------
        InputError
            If it names no boundary, or one without sides.
        """
        has_left = {
            boundary.name: oriented.has_left
            for boundary, oriented in zip(self.scene.boundaries, self.sampled.oriented, strict=True)
        }
        if side is None:
            return {}
        wanted = side if isinstance(side, Mapping) else {name: side for name, has in has_left.items() if has}
        for name, one in wanted.items():
            if name not in has_left:
                raise InputError(
                    f"no boundary has the name {name!r}; the scene has {', '.join(map(repr, has_left)) or 'none'}."
                )
            if one not in SIDES or not has_left[name]:
                raise InputError(
                    f"side of {name!r} must be 'left' or 'right' of a boundary that has sides, got {shown(one)}."
                )
        return wanted

    def signed_distance(self, name: str, points: Any) -> Floats:
        """Return how far (k,) points of the manifold are from a boundary, positive on its left, NaN past its ends."""
        names = [boundary.name for boundary in self.scene.boundaries]
        if name not in names:
            raise InputError(
                f"no boundary has the name {name!r}; the scene has {', '.join(map(repr, names)) or 'none'}."
            )
        return self._locator.signed_distance(names.index(name), self._feet_points(points))

    def conormal_derivative(
        self, u: Floats, points: Any, boundary: str | None = None, side: Side | None = None
    ) -> Floats:
        """Return du/db (k, channels), b out of ``side``, at the points of a boundary nearest to ``points``."""
        if boundary is None or side is None:
            return self._rim_derivative(u, points)
        ((number, _),) = self._numbered({boundary: side}).items()
        oriented, lattice = self.sampled.oriented[number], self.sampled.lattice
        at = as_points(points, self.scene.surface.dim) - oriented.left.origin
        feet, on = oriented.feet(at)
        leftward = oriented.axis_and_left(feet, on, DIFFERENCE_SPACINGS * lattice.spacing)[1]
        where = on.points + oriented.left.origin
        outward = -leftward if side == "left" else leftward
        gradient = self.gradient(u, where, {boundary: side})
        return np.asarray(np.einsum("kcd,kd->kc", gradient, self._conducted(outward, where)))

    def _rim_derivative(self, u: Floats, points: Floats) -> Floats:
        """Return du/db (k, channels) at ``points`` of the edge, b outwards."""
        lattice, surface = self.sampled.lattice, self.sampled.surface
        on = surface.closest_point(lattice.to_local(as_points(points, self.scene.surface.dim)))
        outward = outward_conormals(surface, on, DIFFERENCE_SPACINGS * lattice.spacing)
        feet = lattice.to_scene(on.points)
        return np.asarray(np.einsum("kcd,kd->kc", self.gradient(u, points), self._conducted(outward, feet)))

    def _conducted(self, b: Floats, points: Floats) -> Floats:
        """Return along what (k, d) the slope of u is read for conormals ``b`` (k, d), where A is a tensor A b / b.A b.

        ``points`` (k, d) on the boundary, in the scene's coordinates; A is read inside.
        """
        if not self.scene.has_tensor:
            return b
        inside = points - READ_BESIDE_WIDTHS * self.spacing * b
        tensors = evaluate_diffusivity(self.scene.problem.terms().diffusivity, inside, "the diffusivity")
        along = np.einsum("kij,kj->ki", tensors, b)
        return np.asarray(along / np.einsum("ki,ki->k", b, along)[:, None])
