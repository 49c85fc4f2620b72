"""Which cells beside a boundary are on its left, and coefficients on each side: widths and jumping diffusivities.

A half facet is a facet of the mesh seen from one of its cells. Half facets are on the same side of a boundary if they
share a vertex of the mesh cut along boundaries. The scene defines which side is left
(:class:`cpmkit.scene.oriented.OrientedBoundary`). Its directions to the left are summed along each connected piece of
the boundary, since single directions may be wrong where the boundary is not on the manifold or turns sharply.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from cpmkit.errors import InputError
from cpmkit.forms.galerkin.conditions.boundary_samples import BoundarySamples
from cpmkit.forms.galerkin.space.energy import mean_over_tangents
from cpmkit.grid.lattice import Lattice
from cpmkit.mesh.adjacency import HalfFacets
from cpmkit.mesh.mesh import Mesh
from cpmkit.runtime.index_sets import connected_components
from cpmkit.scene.data import Data, evaluate_data
from cpmkit.scene.diffusivities import SAME_MATERIAL_LOG_RATIO, check_conductivity, evaluate_diffusivity
from cpmkit.scene.oriented import OrientedBoundary
from cpmkit.types import Bools, Floats, Ints

if TYPE_CHECKING:
    from scipy.sparse import csr_array


#: Step of finite differences, in spacings, for normals and tangents of sources that do not provide them.
DIFFERENCE_SPACINGS = 0.5


def signed_distances(boundary: OrientedBoundary, points: Floats, lattice: Lattice) -> Floats:
    """Return the distances (k,) of ``points`` (k, d) from a boundary, positive on its left.

    Points are relative to the lattice's origin. NaN past open ends of the boundary, everywhere if it has no left.
    """
    at = lattice.to_scene(points) - boundary.left.origin
    return boundary.signed_distance(at, DIFFERENCE_SPACINGS * lattice.spacing)


def left_of_boundaries(
    mesh: Mesh,
    half: HalfFacets,
    corners: Ints,
    samples: BoundarySamples,
    boundaries: Sequence[OrientedBoundary],
    lattice: Lattice,
) -> Bools:
    """Return whether each boundary sample (b,) is on the left of its boundary.

    ``half`` are the n half facets on boundaries, ties and rims, on which the ``samples`` lie; ``corners`` (m, k) are
    the vertices of the cells after cutting along boundaries alone. Coordinates are relative to the origin of the
    ``lattice``. The ``boundaries`` are numbered as in ``mesh.owner``. The result is false at points of a surface, on
    boundaries without sides, and where no boundary lies.
    """
    n = len(half.cell)
    if not n or not len(samples):
        return np.zeros(len(samples), dtype=bool)
    rows = np.flatnonzero(samples.half >= 0)
    votes = np.bincount(samples.half[rows], _votes(samples, boundaries, lattice)[rows], n)
    group, piece = _side_and_piece_labels(mesh, half, corners)
    by_group = np.bincount(group, votes, n)[group]
    opposite = np.bincount(piece, votes, n)[piece] - by_group
    sides = np.bincount(piece[np.unique(group, return_index=True)[1]], minlength=n)[piece]
    left = np.where(sides == 2, by_group > opposite, by_group > 0)
    one_sided = (sides == 1) & _has_cell_beyond(half)
    left = np.where(one_sided, votes > 0, left)
    on = np.flatnonzero((samples.half >= 0) & (samples.owner >= 0))  # empty if boundaries are points of a surface
    is_left = np.zeros(len(samples), dtype=bool)
    is_left[on] = left[samples.half[on]]
    return is_left


def side_moments(samples: BoundarySamples, left: Bools, count: int) -> Floats:
    """Return moments (count, d, d + 1) of the conormals out of the left side of each of ``count`` boundaries.

    The moments are the integrals of the conormal times 1 and times each coordinate, zero for boundaries at points. They
    change sign if left and right are swapped, except on rims, and hardly depend on how facets divide the boundary.
    ``left`` (b,) is whether each sample is on the left.
    """
    dim = samples.points.shape[1]
    moments = np.zeros((count, dim, dim + 1))
    rows = np.flatnonzero(left & (samples.owner >= 0) & ~samples.beyond_tip)
    positions = np.hstack([np.ones((len(rows), 1)), samples.points[rows]])
    weighted = samples.weights[rows, None] * samples.conormals[rows]
    np.add.at(moments, samples.owner[rows], weighted[:, :, None] * positions[:, None])
    return moments


def _votes(samples: BoundarySamples, boundaries: Sequence[OrientedBoundary], lattice: Lattice) -> Floats:
    """Return the votes (b,) of samples for their cell being on the left: positive for left, negative for right.

    A vote is the weight of the sample times the inner product of its conormal with the boundary's direction to the
    right, computed at the middle of the facet. It is zero for samples past tips, on no boundary, or on boundaries
    without sides. ``boundaries`` have the numbers in ``samples.owner``.
    """
    votes = np.zeros(len(samples))
    facets = int(samples.facet.max(initial=-1)) + 1
    count = np.bincount(samples.facet[samples.facet >= 0], minlength=facets)
    for number, oriented in enumerate(boundaries):
        rows = np.flatnonzero((samples.owner == number) & (samples.facet >= 0) & ~samples.beyond_tip)
        if not oriented.has_sides or not len(rows):
            continue
        target, place = np.unique(samples.facet[rows], return_inverse=True)
        middles = np.stack([np.bincount(place, x) for x in samples.points[rows].T], axis=1) / count[target, None]
        feet, on = oriented.feet(lattice.to_scene(middles) - oriented.left.origin)
        leftward = oriented.leftward(feet, on, DIFFERENCE_SPACINGS * lattice.spacing)
        votes[rows] = -samples.weights[rows] * np.sum(samples.conormals[rows] * leftward[place], axis=1)
    return votes


def _side_and_piece_labels(mesh: Mesh, half: HalfFacets, corners: Ints) -> tuple[Ints, Ints]:
    """Return two labels (n,) of each half facet, by which votes are summed: the side of its piece, and its piece.

    A piece is a set of facets of a boundary, connected at vertices where exactly two facets of boundaries meet. A facet
    on no boundary has labels of its own. ``corners`` (m, k) are the vertices of cells after cutting along boundaries.
    """
    n, k = len(half.cell), mesh.cells.shape[1]
    owner = np.append(mesh.owner, -1)[half.cut]  # negative on rims and ties
    on = owner >= 0
    piece = np.where(on, half.cut, len(mesh.cut) + np.arange(n))
    if k == 2:  # a boundary is a vertex, and each side of it one segment
        return np.arange(n), _renumber(piece)
    places = (half.facet[:, None] + np.arange(1, k)) % k
    vertex, corner = mesh.cells[half.cell[:, None], places], corners[half.cell[:, None], places]
    meeting = np.bincount(mesh.cut[mesh.owner >= 0].ravel(), minlength=len(mesh.vertices))[vertex]
    rows, places = np.nonzero(on[:, None] & (meeting == 2))
    group = _merge_labels(np.arange(n), rows, np.stack([corner[rows, places], owner[rows]], axis=1))
    return group, _merge_labels(_renumber(piece), rows, np.stack([vertex[rows, places], owner[rows]], axis=1))


def _merge_labels(labels: Ints, rows: Ints, keys: Ints) -> Ints:
    """Return ``labels`` (n,), below n, renumbered from 0, those of ``rows`` (k,) with equal ``keys`` (k, 2) merged."""
    n, node = len(labels), _renumber(keys[:, 0] * (int(keys[:, 1].max(initial=0)) + 1) + keys[:, 1])
    pairs = np.stack([labels[rows], n + node], axis=1)
    return _renumber(connected_components(n + len(rows), pairs)[1][labels])


def _renumber(labels: Ints) -> Ints:
    """Return ``labels`` (n,) renumbered from 0 on without gaps, in the same order."""
    return np.asarray(np.unique(labels, return_inverse=True)[1].ravel(), dtype=np.int64)


def _has_cell_beyond(half: HalfFacets) -> Bools:
    """Return whether (n,) each half facet has a cell on its other side."""
    on = half.cut >= 0
    count = np.bincount(half.cut[on], minlength=int(half.cut.max(initial=-1)) + 1)
    twice = np.zeros(len(half.cut), dtype=bool)
    twice[on] = count[half.cut[on]] > 1
    return twice


#: Ratio of integrals over the manifold and over a straight boundary, weighted with splines, where the manifold is wide.
WIDE_SHARE = 0.89
#: Data are evaluated at once and twice this distance from the boundary, in local widths: a boundary that was moved to
#: the surface is nearer than that to the interface of materials.
READ_INSIDE_WIDTHS = 0.25
#: A value whose logarithm differs by more from the mean nearby belongs to another zone: both values may do so in a
#: sliver that a boundary cuts off beside an edge of the mesh.
OTHER_ZONE_LOG_RATIO = 2.0


def local_widths(
    values: csr_array, integrals: Floats, samples: BoundarySamples, sides: Sequence[Bools], spacing: Floats
) -> Floats:
    """Return the width (b,) of the manifold beside boundary samples, at most h; penalties are proportional to 1 / w.

    ``w(y) = min(h, (sum_j N_j(y) A_j / sum_j N_j(y) L_j) / .89)``, with A_j and L_j the integrals of spline j over the
    manifold and over its side of the boundary.

    ``values`` csr_array (b, n): evaluates the splines N_j at the samples.
    ``integrals`` (n,): A_j.
    ``sides`` sequence of (b,) bool: disjoint sets of ``samples``, such as those on one side of a boundary. L_j is
        summed over each set by itself; samples in no set, and points of a surface, have the width h.
    ``spacing`` (b,): the spacing h of the splines at the samples.
    """
    width, measured = np.array(spacing, dtype=np.float64), np.stack(sides, axis=1) & (samples.half >= 0)[:, None]
    lengths = values @ (values.T @ np.where(measured, samples.weights[:, None], 0.0))
    row, side = np.nonzero(measured)
    width[row] = np.minimum(width[row], (values @ integrals)[row] / lengths[row, side] / WIDE_SHARE)
    return width


@dataclass(frozen=True, eq=False)
class OneSidedLimits:
    """Limits of coefficients at boundary samples, on the side of their cells; coefficients may jump at boundaries."""

    samples: BoundarySamples  #: The b samples.
    widths: Floats  #: (b,): the local width of the manifold, see :func:`local_widths`.
    around: Floats  #: (b,): the mean of the logarithm of the coefficient near each sample.
    lattice: Lattice  #: The coordinates of samples are relative to its origin.

    def value(self, data: Data, label: str) -> Floats:
        """Return the limits (b,) of positive ``data``, a number or function; errors name them by ``label``.

        Functions are evaluated as in :meth:`_extrapolate_limits`. Raises InputError if a value is not positive.
        """
        return self._extrapolate_limits(data, label)[0] if callable(data) else self._positive_values(data, 0.0, label)

    def conormal_flux_factors(self, tensors: Callable[[Floats], Floats]) -> tuple[Floats, Floats]:
        """Return a factor s and directions, which give the conormal flux b . A grad u of tensors A at the samples.

        With s = b . A b and the direction A b / s, whose component along b is 1, the flux is s times the derivative
        along that direction: all conditions hold unchanged with s as diffusivity and this derivative as du/db. The mean
        of A over tangents is extrapolated as in :meth:`value`, and A over its mean linearly from two points inside. If
        b . A b would fall to less than half its value at the nearer point, that ratio is taken from the nearer point.
        Raises InputError if the mean is not positive.

        ``tensors``: A as a function of points (b, d) in the scene's coordinates that returns (b, d, d).
        Returned ``s`` (b,): at points of a surface, which have no conormal, the mean of A over tangents.
        Returned ``directions`` (b, d): A b / s, tangent to the manifold; zero at points of a surface.
        """
        label, normals, b = "the diffusivity", self.samples.normals, self.samples.conormals

        def mean(points: Floats) -> Floats:
            return mean_over_tangents(evaluate_diffusivity(tensors, points, label), normals)

        value, along = self._extrapolate_limits(mean, label)
        step = np.where(along[:, None], *self._inward_steps)
        places = [self.lattice.to_scene(self.samples.points + k * step) for k in (1, 2)]
        near, far = (evaluate_diffusivity(tensors, at, label) / mean(at)[:, None, None] for at in places)
        limit = 2 * near - far
        definite = np.einsum("bi,bij,bj->b", b, limit, b) > 0.5 * np.einsum("bi,bij,bj->b", b, near, b)
        direction = np.einsum("bij,bj->bi", np.where(definite[:, None, None], limit, near), b)
        direction -= np.einsum("bci,bc->bi", normals, np.einsum("bci,bi->bc", normals, direction))
        share = np.einsum("bi,bi->b", b, direction)
        share = np.where(share > 0, share, 1.0)  # zero at points of a surface
        return value * share, direction / share[:, None]

    @property
    def _inward_steps(self) -> tuple[Floats, Floats]:
        """Steps (b, d) from samples into their side: against the conormal, and halfway to the centre of the cell."""
        samples = self.samples
        against = -READ_INSIDE_WIDTHS * self.widths[:, None] * samples.conormals
        return against, 0.5 * (samples.centres - samples.points)

    def _extrapolate_limits(self, data: Data, label: str) -> tuple[Floats, Bools]:
        """Return the limits (b,) of a positive function, and whether (b,) each was evaluated along the conormal.

        The logarithm of the function is evaluated at one and two steps against the conormal, and at one and two steps
        towards the centre of the cell, and each pair is extrapolated linearly to the sample. The first pair of points
        may lie in another zone where boundaries meet, the second pair beyond an interface of materials that is not
        exactly on the boundary. The first limit is taken unless the second is clearly nearer to :attr:`around`; a limit
        far from :attr:`around` is replaced by it. On rims, and where the function is smooth across the boundary (its
        third difference is at most its second), it is evaluated at the sample itself, and the second result is true.
        Raises InputError if a value is not positive.
        """

        def logarithm(step: Floats | float) -> Floats:
            return np.log(self._positive_values(data, step, label))

        inward, into_cell = self._inward_steps
        here, pairs = logarithm(0.0), [(logarithm(step), logarithm(2 * step)) for step in (inward, into_cell)]
        limits = [np.where(np.abs(near - far) < SAME_MATERIAL_LOG_RATIO, 2 * near - far, np.inf) for near, far in pairs]
        off = [np.abs(limit - self.around) for limit in limits]
        by_conormal = off[0] <= off[1] + SAME_MATERIAL_LOG_RATIO
        value = np.where(by_conormal, *limits)
        value = np.where(np.abs(value - self.around) < OTHER_ZONE_LOG_RATIO, value, self.around)
        rim = self.samples.on_rim  # nothing is beyond
        (near, far), beyond = pairs[0], logarithm(np.where(rim[:, None], 0.0, -inward))
        smooth = np.abs(far - 3 * near + 3 * here - beyond) <= np.abs(far - 2 * near + here)
        smooth = rim | (smooth & (np.abs(here - self.around) < OTHER_ZONE_LOG_RATIO))
        return np.exp(np.where(smooth, here, value)), smooth | by_conormal

    def _positive_values(self, data: Data, step: Floats | float, label: str) -> Floats:
        """Return ``data`` (b,) at ``step``, (b, d) or 0, from samples; raise InputError if a value is not positive."""
        values = evaluate_data(data, self.lattice.to_scene(self.samples.points + step), 1, label)[:, 0]
        if np.any(values <= 0):
            raise InputError(f"{label} must be above zero, got {values.min():g}.")
        return values

    def conductivity(self, data: Data, label: str, side: str) -> Floats:
        """Return the conductivity ``data`` (b,) prescribed on one ``side`` of the boundary called ``label``.

        Raises SceneError if it differs by more than 1 % from the diffusivity, exp of :attr:`around`, at more than a
        tenth of the samples, and InputError if it is not positive.
        """
        prescribed, points = self.value(data, f"a conductivity of {label}"), self.lattice.to_scene(self.samples.points)
        check_conductivity(label, side, prescribed, [np.exp(self.around)], points)
        return prescribed
