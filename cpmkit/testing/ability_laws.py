"""The laws of the optional abilities; a source without the ability obeys them."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from itertools import product

import numpy as np

from cpmkit.manifold import abilities
from cpmkit.manifold.source import ClosestPoints, ClosestPointSource
from cpmkit.testing.queries import ROUND_OFF_SHARE, Subject, certain_rows, law, require, require_refusal, require_rows
from cpmkit.types import Floats, Ints

#: Step across or along the manifold by which normals and tangents are checked, relative to the size.
DIRECTION_STEP_SHARE = 1e-5
#: The radii of the searches, relative to the size.
RADII_SHARES = (0.2, 0.5)
#: Length of the step from a foot towards its query, relative to their distance.
TOWARDS_QUERY_SHARE = 1e-3
#: The spacing of a mesh that covers a source, relative to the size, and the largest distance of a foot in spacings.
COVERING_SHARE, COVERED_SPACINGS = 0.05, 1.5
#: Distance from a foot of the points that are compared with it, relative to the size.
AROUND_FOOT_SHARE = 1e-5


@law("near", abilities.HasNormals)
def check_normals(subject: Subject, x: Floats) -> None:
    """Normals have length one and are perpendicular to the manifold, with one sign on both sides of it.

    The closest point of a foot moved along its normal is the foot, to the case's turning angle. At a concave crease it
    is not, so one of the two sides is enough; a crease may turn by more than a right angle, so signs are compared by
    majority.
    """
    feet = subject.feet(x)
    feet = feet.take(certain_rows(feet))
    normals = subject.source.normals(feet)
    _require_unit_length(normals, feet.points)
    feet, normals = feet.take(feet.edge < 0), normals[feet.edge < 0]
    step = DIRECTION_STEP_SHARE * subject.size * normals
    sides = [subject.source.closest_point(np.ascontiguousarray(feet.points + s * step)) for s in (1.0, -1.0)]
    slid = np.min([np.linalg.norm(side.points - feet.points, axis=1) for side in sides], axis=0)
    allowed = (1e-3 + subject.case.turning_angle) * DIRECTION_STEP_SHARE * subject.size + subject.round_off(feet.points)
    require_rows(slid <= allowed, feet.points, "Moved along its normal, the foot slides", slid)
    above, below = (subject.source.normals(side) for side in sides)
    _require_agreement(above, below, feet.points, "The two sides have opposite normals")


@law("near", abilities.HasCreases)
def check_facet_normals(subject: Subject, x: Floats) -> None:
    """Normals of facets have length one, or are NaN in all coordinates."""
    feet = subject.feet(x)
    normals = subject.source.facet_normals(feet)
    flat = np.isfinite(normals).any(axis=1)
    _require_unit_length(normals[flat], feet.points[flat])


@law("anywhere", abilities.HasInside)
def check_inside(subject: Subject, x: Floats) -> None:
    """Closest points are those of ``closest_point``; a far point is outside, and the manifold separates both sides.

    Two points on different sides are at least as far from each other as their distances from an exact manifold add up.
    """
    feet, inside = subject.source.closest_point_and_inside(x.copy())
    require(inside.shape == (len(x),) and inside.dtype == bool, f"Whether {len(x)} points are inside is {inside!r}.")
    off = np.linalg.norm(feet.points - subject.feet(x).points, axis=1)
    require_rows(off <= subject.round_off(x), x, "The closest point differs from that of closest_point by", off)
    far = subject.centre + 10 * subject.size
    require(not subject.source.closest_point_and_inside(far[None])[1][0], f"The far point {far} is inside.")
    others = np.roll(x, 1, axis=0)
    excess = feet.distance + np.roll(feet.distance, 1) - np.linalg.norm(x - others, axis=1)
    separated = (excess <= subject.round_off(x) + subject.round_off(others)) | (inside == np.roll(inside, 1))
    require_rows(
        separated | (not subject.source.exact), x, "No point is between it and one on the other side, nearer by", excess
    )


@law("near", abilities.HasTangents)
def check_tangents(subject: Subject, x: Floats) -> None:
    """Tangents have length one, lie along the curve, and those of neighbouring feet have the same direction."""
    feet = subject.feet(x)
    feet = feet.take(certain_rows(feet))
    _require_unit_length(subject.source.tangents(feet), feet.points)
    feet = feet.take(feet.edge < 0)
    tangents = subject.source.tangents(feet)
    ahead = subject.source.closest_point(
        np.ascontiguousarray(feet.points + DIRECTION_STEP_SHARE * subject.size * tangents)
    )
    progress = np.einsum("nd,nd->n", ahead.points - feet.points, tangents) / (DIRECTION_STEP_SHARE * subject.size)
    # At a corner that turns by a the tangent is the bisector, and the foot advances by cos^2(a / 2).
    require_rows(progress > 0.01, feet.points, "Moved along its tangent, the foot advances by the share", progress)
    _require_agreement(subject.source.tangents(ahead), tangents, feet.points, "Neighbours have opposite tangents")


@law("near", abilities.HasValues)
def check_values(subject: Subject, x: Floats) -> None:
    """Interpolation preserves constants and the number of channels."""
    values = np.tile([3.0, -1.0], (subject.source.value_count, 1))

    read = subject.source.interpolate(values, subject.feet(x))
    require(read.shape == (len(x), 2), f"Data of 2 channels at {len(x)} feet are read as {read.shape}.")
    require_rows((np.abs(read - values[0]) <= ROUND_OFF_SHARE).all(axis=1), x, "The constants 3, -1 are read as", read)


@law(ability=abilities.HasMesh)
def check_mesh(subject: Subject) -> None:
    """The vertices of a mesh lie on the manifold; cells are points, or of its dimension, with distinct corners."""
    for share in (0.5, 0.05):
        vertices, cells = subject.source.mesh(share * subject.size)
        require(vertices.dtype == np.float64 and cells.dtype == np.int64, f"It holds {vertices.dtype}, {cells.dtype}.")
        require(
            vertices.ndim == 2 and vertices.shape[1] == subject.source.dim, f"Vertices have shape {vertices.shape}."
        )
        require(cells.ndim == 2 and len(cells), f"Cells have shape {cells.shape}.")
        _require_corners(cells, subject.source.manifold_dim)
        require(cells.max() < len(vertices), "A cell names a vertex that is not there.")
        ordered = np.sort(cells, axis=1)
        once = (ordered[:, 1:] > ordered[:, :-1]) | (ordered[:, 1:] < 0)
        require(once.all(), "A cell names a vertex twice.")
        off = subject.source.closest_point(np.ascontiguousarray(vertices)).distance
        require_rows(off <= subject.round_off(vertices), vertices, "A vertex lies off the manifold by", off)


@law("near", abilities.HasMesh, together=True)
def check_mesh_covers(subject: Subject, x: Floats) -> None:
    """The mesh covers a curve or surface: it has a point within a spacing or so of each foot."""
    from scipy.spatial import cKDTree

    if subject.source.manifold_dim in (1, 2):
        spacing = COVERING_SHARE * subject.size
        vertices, cells = subject.source.mesh(spacing)
        corners = vertices[cells[:, : subject.source.manifold_dim + 1]]
        longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max()
        parts = max(1, int(np.ceil(longest / spacing)))  # of each side; their corners are points of the mesh
        shares = np.array([each for each in product(range(parts + 1), repeat=corners.shape[1]) if sum(each) == parts])
        off = cKDTree(np.concatenate(shares / parts @ corners)).query(subject.feet(x).points)[0]
        require_rows(off <= COVERED_SPACINGS * spacing, x, "Off the mesh lies a foot by", off)


@law(ability=abilities.HasAdvice)
def check_advice(subject: Subject) -> None:
    """Each warning is one sentence, a string that ends with its only full stop; floors are finite, not negative."""
    for share in (0.5, 0.05, 0.005):
        advice = subject.source.advice(share * subject.size)
        for warning in (*advice.warnings, *advice.closest_point_warnings):
            require(isinstance(warning, str), f"A warning is {warning!r}, not a string.")
            whole = warning.endswith(".") and warning == warning.strip() and ". " not in warning
            require(whole, f"The warning {warning!r} is not one sentence that ends with a full stop.")
        require(isinstance(advice.floor, float), f"The floor is {advice.floor!r}, not a float.")
        for floor in (advice.floor, advice.integral_floor or 0.0):
            require(np.isfinite(floor) and floor >= 0, f"The floor is {floor}.")


@law("near", abilities.HasAdvice)
def check_finite_feet(subject: Subject, x: Floats) -> None:
    """A source whose feet are finitely many has no more of them than its advice states."""
    count = subject.source.advice(subject.size).foot_count
    if count is not None:
        feet = np.unique(subject.source.closest_point(x).points, axis=0)
        require(len(feet) <= count, f"There are {len(feet)} feet at least, not {count}.")


@law("near unless exact", abilities.HasTranslation, together=True)
def check_translation(subject: Subject, x: Floats) -> None:
    """A translated source has the source's answers, moved by the offset, and the same abilities.

    Feet are compared by their distances from the query and the manifold: at a tie rounding may choose another.
    """
    offset = subject.size * np.array([3.0, -50.0, 0.3])[: subject.source.dim]
    moved = subject.source.translate(offset)
    for ability in abilities.ABILITIES:
        same = isinstance(moved, ability) == isinstance(subject.source, ability)
        require(same, f"Only one of the two has {ability.__name__}.")
    apart = np.abs(moved.bounds - (subject.source.bounds + offset)).max()
    require(apart <= subject.round_off(offset[None])[0], f"The bounds move by the offset and {apart}.")

    original, translated = subject.feet(x), moved.closest_point(x + offset)
    allowed = 2 * subject.round_off(np.abs(x) + np.abs(offset))
    apart = np.abs(translated.distance - original.distance)
    require_rows(apart <= allowed, x, "distance changes in translation by", apart)
    off = subject.source.closest_point(np.ascontiguousarray(translated.points - offset)).distance
    require_rows(off <= allowed, x, "The translated foot lies off the translated manifold by", off)
    apart = np.abs(np.linalg.norm(x + offset - translated.points, axis=1) - np.linalg.norm(x - original.points, axis=1))
    require_rows(apart <= allowed + subject.case.turning_angle * original.distance, x, "|x - points| changes by", apart)


@law("near", abilities.HasSkin)
def check_skin(subject: Subject, x: Floats) -> None:
    """The skin of a solid is a hypersurface with the closest points of queries outside."""
    skin, feet = subject.source.skin, subject.feet(x)
    require(skin.manifold_dim == skin.dim - 1 == subject.source.dim - 1, "The skin is no hypersurface.")
    feet = feet.take(feet.edge >= 0)
    off = skin.closest_point(np.ascontiguousarray(feet.points)).distance
    require_rows(off <= subject.round_off(feet.points), feet.points, "The foot lies off the skin by", off)


@law("near", abilities.HasLeft)
def check_left(subject: Subject, x: Floats) -> None:
    """Vectors to the left have length one and are perpendicular to tangents; ``left_of``, where stated, lies left."""
    feet = subject.source.closest_point(x)
    feet = feet.take(certain_rows(feet))
    left = subject.source.leftward(feet)
    _require_unit_length(left, feet.points)
    if isinstance(subject.source, abilities.HasTangents):
        along = np.abs(np.sum(left * subject.source.tangents(feet), axis=1))
        require_rows(along <= ROUND_OFF_SHARE, feet.points, "A vector to the left leans along the curve by", along)
    left_of = getattr(subject.source, "left_of", None)
    if left_of is not None:
        point = np.asarray(left_of, dtype=np.float64)[None]
        feet = subject.source.closest_point(point)
        on_left = bool(np.sum((point - feet.points) * subject.source.leftward(feet)) > 0)
        require(on_left, f"left_of, {point[0].tolist()}, is not on the left.")


def _require_corners(cells: Ints, manifold_dim: int | None) -> None:
    """Raise AssertionError unless ``cells`` (m, k) are triangles (surfaces, solids), segments (curves) or points.

    Only a union of mixed dimension (``manifold_dim`` None) has rows that end in -1, and no more columns than its
    largest cells need.
    """
    require(1 <= cells.shape[1] <= 3, f"Cells have shape {cells.shape}.")
    missing = cells < 0
    require((cells >= -1).all() and not missing[:, 0].any(), "A cell has a negative corner, or none.")
    if manifold_dim is None:
        require(not missing.all(axis=0).any(), f"No cell has {cells.shape[1]} corners.")
        require((missing[:, 1:] >= missing[:, :-1]).all(), "A row goes on after -1.")
        return
    require(not missing.any(), f"A cell ends in -1 although the manifold has one dimension, {manifold_dim}.")
    corners = (1, min(manifold_dim + 1, 3))
    require(
        cells.shape[1] in corners, f"Cells of a manifold of dimension {manifold_dim} have {cells.shape[1]} corners."
    )


def _require_unit_length(vectors: Floats, points: Floats) -> None:
    """Raise AssertionError unless ``vectors`` have the shape (n, d) of ``points``, type float64 and length one."""
    require(vectors.shape == points.shape, f"There are {vectors.shape} vectors for {points.shape} feet.")
    require(vectors.dtype == np.float64, f"Vectors are {vectors.dtype}, not float64.")
    length = np.linalg.norm(vectors, axis=1)
    require_rows(np.abs(length - 1) <= ROUND_OFF_SHARE, points, "A vector has the length", length)


def _require_agreement(first: Floats, second: Floats, points: Floats, message: str) -> None:
    """Raise AssertionError (``message``) if ``first``, ``second`` (n, d) have no acute angle at most of ``points``."""
    opposite = np.einsum("nd,nd->n", first, second) <= 0
    if len(points) and opposite.mean() > 0.5:
        require_rows(~opposite, points, message)


@law("anywhere", abilities.HasLocalMinima)
def check_local_minima(subject: Subject, x: Floats) -> None:
    """Feet within a radius lie on the manifold at their distance, ordered by row and distance, the closest point first.

    A larger radius adds feet and removes none.
    """
    small, large = (share * subject.size for share in RADII_SHARES)

    closest = subject.feet(x)
    rows, feet = subject.source.local_minima(x, large)
    _require_order(subject, x, rows, feet)
    expected = np.flatnonzero(closest.distance <= large)
    require(
        np.array_equal(np.unique(rows), expected), "The queries with feet are not those whose closest point is near."
    )
    require((feet.distance <= large).all(), "A foot lies beyond the radius.")
    first = np.flatnonzero(np.diff(rows, prepend=-1))
    apart = np.abs(_foot_distances(x, rows, feet)[first] - np.linalg.norm(x - closest.points, axis=1)[rows[first]])
    allowed = subject.round_off(x)[rows]
    require_rows(apart <= allowed[first], x[rows[first]], "The first foot is not the closest point, by", apart)
    off = subject.source.closest_point(np.ascontiguousarray(feet.points)).distance
    require_rows(off <= subject.round_off(feet.points), x[rows], "A foot lies off the manifold by", off)
    excess = feet.distance - _foot_distances(x, rows, feet)
    require_rows(excess <= allowed, x[rows], "distance is above |x - points| by", excess)
    if subject.source.exact:
        require_rows(-excess <= allowed, x[rows], "distance is below |x - points| by", -excess)
    within = subject.source.local_minima(x, small)[1]
    same = np.array_equal(within.points, feet.points[feet.distance <= small])
    require(same, "The feet within a small radius are not those that a large one finds there.")


@law("near unless exact", abilities.HasLocalMinima)
def check_sheets(subject: Subject, x: Floats) -> None:
    """Feet of one query are distinct local minima; each is the closest point of a point a little nearer the query.

    The query therefore lies along the normal, between the normals at a crease, or beyond the edge. For an exact source
    other points around a foot are farther away. The members of a union are checked one by one: where two touch, a foot
    on one may be no local minimum of both.
    """
    rows, feet = subject.source.local_minima(x, RADII_SHARES[1] * subject.size)
    for member, chosen in _member_feet(subject.source, feet):
        _require_distinct_feet(x, rows[chosen], feet.take(chosen), subject)
        chosen = chosen[certain_rows(feet.take(chosen))]
        points, towards = feet.points[chosen], TOWARDS_QUERY_SHARE * (x[rows[chosen]] - feet.points[chosen])
        nearest = member.closest_point(np.ascontiguousarray(points + towards)).points
        slid = np.linalg.norm(nearest - points, axis=1)
        allowed = subject.case.turning_angle * np.linalg.norm(towards, axis=1) + subject.round_off(points)
        require_rows(slid <= allowed, x[rows[chosen]], "From a point nearer the query, the foot slides", slid)
        if member.exact:
            _require_minima(member, x[rows[chosen]], points, subject)


@law(ability=abilities.HasLocalMinima)
def check_bad_radius(subject: Subject) -> None:
    """Wrong queries, and a radius not above zero, are refused with InputError; no queries have no feet."""
    good, dim = subject.centre[None], subject.source.dim
    rows, feet = subject.source.local_minima(np.empty((0, dim)), subject.size)
    require(len(rows) == len(feet) == 0, "No queries have feet.")
    for x, radius in (
        (good * np.nan, 1.0),
        (np.zeros((4, dim + 1)), 1.0),
        (good, 0.0),
        (good, -1.0),
        (good, float("nan")),
    ):
        call = partial(subject.source.local_minima, x, radius)
        require_refusal(call, f"the shape {x.shape} and a radius of {radius}")


def _foot_distances(x: Floats, rows: Ints, feet: ClosestPoints) -> Floats:
    """Return the distances (k,) of feet from their queries, the rows ``rows`` (k,) of ``x``."""
    return np.asarray(np.linalg.norm(x[rows] - feet.points, axis=1))


def _require_order(subject: Subject, x: Floats, rows: Ints, feet: ClosestPoints) -> None:
    """Raise AssertionError unless ``rows`` (k,) are int64 and ascend, and each query's feet ascend in distance."""
    require(rows.dtype == np.int64 and rows.shape == (len(feet),), f"{rows.dtype} {rows.shape} rows of {len(feet)}.")
    step = np.diff(rows)
    require((step >= 0).all(), "The rows do not ascend.")
    back = -np.diff(feet.distance)[step == 0]
    require_rows(
        back <= subject.round_off(x)[rows[1:][step == 0]], x[rows[1:]][step == 0], "Feet come nearer, by", back
    )


def _member_feet(source: ClosestPointSource, feet: ClosestPoints) -> Iterator[tuple[ClosestPointSource, Ints]]:
    """Yield each member of a union, or the source itself, with the indices (k,) of its points among ``feet``."""
    for number, member in enumerate(abilities.members_of(source)):
        everywhere = not isinstance(source, abilities.HasMembers)
        yield member, np.arange(len(feet)) if everywhere else np.flatnonzero(feet.element == number)


def _require_distinct_feet(x: Floats, rows: Ints, feet: ClosestPoints, subject: Subject) -> None:
    """Raise AssertionError if two of k ``feet`` with one query coincide; ``rows`` (k,) are the queries in ``x``."""
    order = np.lexsort((*feet.points.T, rows))
    ahead = np.roll(order, -1)
    apart = np.linalg.norm(feet.points[ahead] - feet.points[order], axis=1)
    twice = (rows[ahead] == rows[order]) & (ahead != order) & (apart <= subject.round_off(feet.points[order]))
    require_rows(~twice, x[rows[order]], "Two feet are apart by", apart)


def _require_minima(source: ClosestPointSource, x: Floats, points: Floats, subject: Subject) -> None:
    """Raise AssertionError if, of two opposite points beside a foot, both are nearer to its query.

    ``x`` (k, d) are the queries, ``points`` (k, d) their feet. One of the two points may be nearer where the foot is
    beside the edge of a facet.
    """
    step = AROUND_FOOT_SHARE * subject.size * np.random.default_rng(0).normal(size=points.shape)
    both = [source.closest_point(np.ascontiguousarray(points + sign * step)).points for sign in (1.0, -1.0)]
    gain = np.linalg.norm(x - points, axis=1) - np.max([np.linalg.norm(x - side, axis=1) for side in both], axis=0)
    require_rows(gain <= subject.round_off(x), x, "There are nearer points on both sides of a foot, by", gain)
