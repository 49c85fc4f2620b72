"""The closest point source of a level set, whole or trimmed."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from cpmkit.plugin import (
    Advice,
    Bools,
    ClosestPoints,
    Floats,
    InputError,
    Ints,
    as_points,
    as_vector,
    norms,
    positive,
    source_repr,
)
from cpmkit_levelset.creases import common_points, edge_layers, surface_layers
from cpmkit_levelset.fields import Field, FunctionField
from cpmkit_levelset.formulas import FormulaField
from cpmkit_levelset.manifold import ZeroSet, unit_or_nan
from cpmkit_levelset.marching import marching_simplices
from cpmkit_levelset.sampling import COVERING_SPACINGS, evaluate_chunked, exit_points, sample_lattice, surface_samples
from cpmkit_levelset.search import LayeredSet

#: Queries that are answered at a time: temporary arrays stay in the cache.
LEVELSET_PARCEL_QUERIES = 8192
#: A foot closer than this to the edge, relative to the size, lies on it.
ON_LEVELSET_EDGE_SHARE = 1e-11
#: The error of a solution, as a share of its range, over that of the field's slope. Spheres from values on 10 to 28
#: grid points a side, u = z: 0.06 to 0.4.
ERROR_PER_FIELD_SLOPE = 0.13
#: Relative error of a gradient by differences above which there is a warning.
ROUGH_SLOPE_SHARE = 1e-6
#: A mesh has at least this many cells along the longest side of the bounds.
LEVELSET_LEAST_CELLS = 16


@dataclass(frozen=True, eq=False)
class LevelSet:
    """The points at which a field vanishes and changes sign, of these those with trim <= 0.

    Attributes
    ----------
    field : Field
        The function phi.
    trim : FormulaField or None
        The function that is at most zero on the part; None: the whole.
    box : (2, d) float64
        The corners of the box in which the zero set lies, as it was given.
    surface : LayeredSet
        Samples of the zero set, and of what lies a little beyond its edge.
    edge : LayeredSet or None
        Samples of the edge.
    shift : (d,) float64
        Added to every foot: how far the source was translated.
    slope_error : float
        By how much the field's slope is off on the zero set, as a share of it; 0 for a formula.
    """

    field: Field
    trim: FormulaField | None
    box: Floats
    surface: LayeredSet
    edge: LayeredSet | None
    shift: Floats
    slope_error: float = 0.0

    __repr__ = source_repr

    @property
    def dim(self) -> int:
        """Dimension of the space."""
        return self.field.dim

    @property
    def manifold_dim(self) -> int:
        """Dimension of the space less 1."""
        return self.dim - 1

    @property
    def exact(self) -> bool:
        """True: feet are true nearest points, but for those that are ``doubtful``."""
        return True

    @property
    def bounds(self) -> Floats:
        """(2, d) corners of the box around the level set, larger by a millionth of the diagonal of that given."""
        return self._extent + self.shift

    def closest_point(self, x: Floats, /) -> ClosestPoints:
        """Return the closest points of ``x`` (n, d).

        ``edge`` is 0 where the foot lies on the edge of a trimmed surface; of a trimmed curve, 0 or 1, its ends by
        increasing coordinates; -1 elsewhere. Feet are ``doubtful`` where not every sample that may lead to a nearer
        point could be tried, the surface curves too much for its samples, or Newton's method did not converge: they lie
        on the surface, and nothing nearer was found. Raise InputError if ``x`` holds NaN or infinity, or its shape is
        not (n, d).
        """
        x = as_points(x, self.dim) - self.shift
        points, distance = np.empty_like(x), np.empty(len(x))
        edge, doubtful = np.full(len(x), -1), np.zeros(len(x), dtype=bool)
        for start in range(0, len(x), LEVELSET_PARCEL_QUERIES):
            part = slice(start, start + LEVELSET_PARCEL_QUERIES)
            points[part], distance[part], edge[part], doubtful[part] = self._find_feet(x[part])
        return ClosestPoints(points + self.shift, distance, edge, doubtful=doubtful)

    def normals(self, feet: ClosestPoints, /) -> Floats:
        """Return (n, d) unit normals at ``feet`` in the direction of phi's gradient; NaN where that vanishes.

        On a crease they are those of one face, or between those of its faces.
        """
        return unit_or_nan(self.field.gradient(feet.points - self.shift)[1])

    def mesh(self, spacing: float, /) -> tuple[Floats, Ints]:
        """Return vertices (v, d) on the level set and cells (m, d), triangles or segments, of about ``spacing`` > 0.

        The spacing is at most a sixteenth of the largest side of the box in which phi was given. Triangles are wound
        counterclockwise as seen from where phi grows; segments have that on their right.
        """
        coarsest = float((self.box[1] - self.box[0]).max()) / LEVELSET_LEAST_CELLS
        lattice = sample_lattice(self.field, self.box, min(positive(spacing, "spacing"), coarsest))
        vertices, cells = marching_simplices(lattice)
        if self.trim is not None:
            cells = cells[(self.trim.value(vertices) <= 0)[cells].any(axis=1)]
            used, cells = np.unique(cells, return_inverse=True)
            vertices, cells = vertices[used], cells.reshape(-1, self.dim)
        feet = self.closest_point(vertices + self.shift)
        return feet.points, self._orient_cells(feet, cells)

    def advice(self, _spacing: float, /) -> Advice:
        """Return the error that the field's error causes in a solution at any spacing.

        A gradient by differences that is far off gives a warning. Only meshes of curves serve for samples.
        """
        warnings = ()
        if isinstance(self.field, FunctionField) and self.slope_error > ROUGH_SLOPE_SHARE:
            warnings = (
                f"The gradient of phi, taken by differences, is off by up to {self.slope_error:.1g} of its length on "
                "the level set: give gradient=..., or a smoother phi.",
            )
        # segments serve for quadrature; triangles out of cut tetrahedra are too many and too distorted
        return Advice(ERROR_PER_FIELD_SLOPE * self.slope_error, warnings, mesh_for_samples=self.dim == 2)

    def translate(self, offset: Floats, /) -> LevelSet:
        """Return the level set translated by ``offset``, (d,) finite numbers."""
        return replace(self, shift=self.shift + as_vector(offset, self.dim, "offset"))

    def _find_feet(self, x: Floats) -> tuple[Floats, Floats, Ints, Bools]:
        """Return points (n, d), distances, edges and doubts (n,) of queries ``x`` (n, d), without the shift."""
        if self.edge is None:
            result = self.surface.find_nearest(x)
            return result.points, result.distance, np.full(len(x), -1), ~result.sure
        rim = self.edge.find_nearest(x)
        result = self.surface.find_nearest(x, rim.distance, self._is_inside)
        on_rim = ~(result.distance < rim.distance)
        # the edge is nowhere nearer than the foot on it less the covering radius: beyond that its doubts do not count
        sure = result.sure & (rim.sure | (result.distance < rim.distance - self.edge.layers[0].covering))
        points = np.where(on_rim[:, None], rim.points, result.points)
        distance = np.where(on_rim, rim.distance, result.distance)
        return points, distance, np.where(on_rim, self._edge_numbers(rim.points), -1), ~sure

    def _edge_numbers(self, points: Floats) -> Ints:
        """Return (n,) 0 for ``points`` (n, d) on the edge of a surface; of a curve, the number of the nearest end."""
        if self.dim == 3 or self.edge is None:
            return np.zeros(len(points), dtype=np.int64)
        number: Ints = self.edge.layers[0].tree.query(points)[1].astype(np.int64)
        return number

    def _is_inside(self, points: Floats) -> Bools:
        """Return (n,) whether ``points`` (n, d) of the zero set belong to the trimmed part, off its edge."""
        assert self.trim is not None
        value, gradient = self.trim.gradient(points)
        inside: Bools = value < -ON_LEVELSET_EDGE_SHARE * self.surface.size * norms(gradient)
        return inside

    def _orient_cells(self, feet: ClosestPoints, cells: Ints) -> Ints:
        """Return the ``cells`` (m, d) of positive area, their vertices at ``feet`` in the order of :meth:`mesh`."""
        corners, normal = feet.points[cells], self.normals(feet)[cells].sum(axis=1)
        sides = corners[:, 1:] - corners[:, :1]
        if self.dim == 2:
            right = np.stack([sides[:, 0, 1], -sides[:, 0, 0]], axis=1)
        else:
            right = np.cross(sides[:, 0], sides[:, 1])
        flipped = (right * normal).sum(axis=1) < 0
        cells = np.where(flipped[:, None], cells[:, ::-1], cells)
        return cells[norms(right) > 0]

    @cached_property
    def _extent(self) -> Floats:
        """(2, d) the box, a little widened, around the feet of queries so far away that these are extreme points."""
        size, centre = self.surface.size, self.box.mean(axis=0)
        directions = np.concatenate([-np.eye(self.dim), np.eye(self.dim)])
        extremes = self._find_feet(centre + 1e6 * size * directions)[0]
        extent: Floats = np.stack([extremes.min(axis=0), extremes.max(axis=0)]) + 1e-6 * size * np.array(
            [[-1.0], [1.0]]
        )
        return extent


def level_set(field: Field, trim: FormulaField | None, box: Floats, resolution: int) -> LevelSet:
    """Return the level set of ``field`` in ``box`` (2, d), sampled with ``resolution`` cells along its longest side.

    Raise InputError if phi is not finite on the lattice of samples, has no zero set there, or one that runs out of the
    box where ``trim`` <= 0; or if ``trim`` leaves nothing of it, or cuts a curve at more than two points.
    """
    size = float(norms((box[1] - box[0])[None])[0])
    spacing = float((box[1] - box[0]).max()) / resolution
    lattice = sample_lattice(field, box, spacing)
    zero_set = ZeroSet((field,), size)
    samples = surface_samples(zero_set, lattice)
    kept = (
        np.ones(lattice.values.size, dtype=bool) if trim is None else evaluate_chunked(trim.value, lattice.nodes) <= 0
    )
    leaks = exit_points(lattice, kept)
    if len(leaks):
        raise InputError(
            f"the zero set runs out of the bounds at {len(leaks)} lattice points, first near {leaks[0].tolist()}; "
            "widen the bounds until they hold it, or cut it off inside of them with trim."
        )
    kinks, edge = (field.kinks if isinstance(field, FormulaField) else ()), None
    if trim is not None:
        samples, edge = _trim_samples(field, trim, samples, size, spacing, kinks)
    return LevelSet(field, trim, box, surface_layers(zero_set, samples, kinks, spacing), edge, np.zeros(field.dim))


def _trim_samples(
    field: Field, trim: FormulaField, samples: Floats, size: float, spacing: float, kinks: tuple[FormulaField, ...]
) -> tuple[Floats, LayeredSet | None]:
    """Return the samples where trim <= 0, or nearly so, and the layers of the edge, None if nothing is cut.

    ``spacing`` is that of the lattice; ``kinks`` are those of ``field``. Raise InputError if no
    sample is left, or a curve has more than two ends.
    """
    inside = trim.value(samples) <= 0
    if not inside.any():
        raise InputError("trim leaves nothing of the zero set: it keeps the points where trim <= 0; change its sign.")
    rim = ZeroSet((field, trim), size)
    points = common_points(rim, samples, spacing)
    if not len(points):
        return samples[inside], None
    near = inside | (rim.distance_estimate(samples) <= COVERING_SPACINGS * spacing)
    if field.dim == 2:
        return samples[near], edge_layers(rim, _distinct_ends(points, size), (), spacing)
    return samples[near], edge_layers(rim, points, (*trim.kinks, *kinks), spacing)


def _distinct_ends(points: Floats, size: float) -> Floats:
    """Return the different ones of ``points`` (n, 2), by increasing coordinates; raise InputError for more than two."""
    ordered = points[np.lexsort(np.round(points.T[::-1] / (1e-6 * size)))]
    ends: Floats = ordered[np.append(True, norms(np.diff(ordered, axis=0)) > 1e-6 * size)]
    if len(ends) > 2:
        raise InputError(f"trim cuts the curve at {len(ends)} points; a trimmed curve is one piece with two ends.")
    return ends
