"""Contacts over discs: where curves meet surfaces at points, and along curves in solids in space."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from cpmkit.errors import SceneError, place
from cpmkit.forms.galerkin.conditions.imposed_conditions import Tie, conditions_with_law
from cpmkit.forms.galerkin.form import Galerkin
from cpmkit.forms.galerkin.unions.junctions import DiscContact
from cpmkit.forms.galerkin.unions.union_parts import UnionPart
from cpmkit.manifold.abilities import members_of
from cpmkit.manifold.meetings import Meeting, edges_near, meetings_of, touching_distance
from cpmkit.manifold.vector_algebra import normal_frames, norms, unit
from cpmkit.scene.junction import Junction, junction_of
from cpmkit.scene.scene import Scene
from cpmkit.types import Floats, Ints, SparseMatrix

#: The radius of the disc: so many spacings, and at least so many radii of the curve. With 3 spacings v is off by .0005
#: in a solid for a flow of 1, with 2 by .003 (measured); with 2 radii R' is above R.
DISC_SPACINGS, DISC_RADII = 3.0, 2.0
#: Numbers of circles for the mean over a disc, the nodes of a Gauss rule in t, and of points of each.
CIRCLES, CIRCLE_POINTS = 6, 16
#: The radius of a curve is at most this share of the largest side of the surface or solid: the part of that inside the
#: radius, which stays, then changes values by a few percent at most.
LARGEST_RADIUS_SHARE = 0.1
#: A curve that runs nearer than a spacing to the boundary of a solid, farther than so many spacings from its own ends
#: there, has a warning: v is off by 1 to 3 percent at half a spacing from it (measured).
ENDS_SPACINGS = 3.0


def disc_contacts(scene: Scene, parts: Sequence[UnionPart]) -> dict[tuple[int, int], DiscContact]:
    """Return the contacts over discs of the ``parts`` of a union, by the numbers of the higher and the lower part.

    Raises SceneError for a tensor as diffusivity, a radius that is not small, a disc that leaves its surface, or
    different laws at one point.
    """
    dims, found = [part.dim for part in parts], {}
    at_points, inside = (
        [meeting for meeting in meetings_of(scene.surface) if meeting.how == how] for how in ("points", "inside")
    )
    if (at_points or inside) and scene.has_tensor:
        raise SceneError(
            "where a curve meets a surface at a point, or lies in a solid, the diffusivity must be a number or a "
            "function that returns numbers, got a tensor."
        )
    if at_points:
        high, low = dims.index(2), dims.index(1)
        found[high, low] = _contact_at_points(scene, parts[high].form, parts[low].form, at_points)
    if inside:
        high, low = dims.index(3), dims.index(1)
        found[high, low] = _contact_along_curves(scene, parts[high].form, parts[low], inside)
    return found


def disc_rule(radius: Floats, spacing: float) -> tuple[Floats, Floats, Floats]:
    """Return radii and weights, (k, CIRCLES) each, of circles, and L (k,), for curves of ``radius`` (k,).

    They are those of :mod:`cpmkit.forms.galerkin.unions.junctions`: weights have the sum 1.
    """
    from scipy.special import roots_jacobi

    size = np.maximum(DISC_SPACINGS * spacing, DISC_RADII * radius)
    # the integral of (1 - t) t^j is 1 / ((j + 1)(j + 2))
    moments = np.stack([np.ones(len(radius)), (radius / size) ** 2])
    alpha, beta = np.linalg.solve([[1 / 2, 1 / 6], [1 / 6, 1 / 12]], moments)
    nodes, weights = roots_jacobi(CIRCLES, 1, 0)  # for the weight 1 - t on [-1, 1]
    t = (1 + nodes) / 2
    density = np.stack([alpha, beta - alpha, -beta], axis=1)  # f, by powers of t
    i, j = np.ogrid[:3, :3]
    log = np.log(size) - np.einsum("ki,kj,ij->k", density, density, 1 / ((j + 1) * (i + j + 2.0) ** 2))
    return size[:, None] * np.sqrt(t), (alpha[:, None] + beta[:, None] * t) * weights / 4, log


def mean_over_discs(form: Galerkin, at: Floats, frames: Floats, radius: Floats) -> tuple[SparseMatrix, Floats]:
    """Return the matrix (k, n) of m(u) at points ``at`` (k, d) of curves of ``radius`` (k,) on a surface or in a solid.

    Also L - log r (k,). ``frames`` (k, 2, d) are orthonormal and span the planes of the discs. On a surface the points
    of a circle have the distance of its radius in space. Where a disc leaves a solid, its closest points on the solid
    count. Raises SceneError if a disc leaves the surface.
    """
    from scipy.sparse import csr_array

    angles = 2 * np.pi * (np.arange(CIRCLE_POINTS) + 0.5) / CIRCLE_POINTS
    around = np.cos(angles)[:, None] * frames[:, :1] + np.sin(angles)[:, None] * frames[:, 1:]
    is_solid = form.scene.surface.manifold_dim == at.shape[1]
    total = csr_array((len(at), form.size))
    radii, weights, log = disc_rule(radius, form.spacing)
    for p, weight in zip(radii.T, weights.T, strict=True):
        offset = around
        for _ in range(1 if is_solid else 2):  # the second time the chords have the length of the radius
            points = at[:, None] + p[:, None, None] * offset
            feet = form.scene.surface.closest_point(points.reshape(-1, at.shape[1]))
            offset = unit(feet.points.reshape(points.shape) - at[:, None])
        past = np.flatnonzero(feet.edge >= 0)
        if len(past) and not is_solid:
            raise SceneError(
                f"a curve meets a surface near {place(at[past[0] // CIRCLE_POINTS])}, nearer to the edge of the "
                f"surface than {p.max():.3g}; use a smaller spacing, or move the junction inside."
            )
        rows = form.evaluation_matrix(feet.points)
        starts = np.arange(0, rows.shape[0] + 1, CIRCLE_POINTS)
        shares = np.repeat(weight / CIRCLE_POINTS, CIRCLE_POINTS), np.arange(rows.shape[0]), starts
        total = total + csr_array(shares, shape=(len(at), rows.shape[0])) @ rows
    return total.tocsr(), log - np.log(radius)


def nearest_samples(form: Galerkin, at: Floats) -> Ints:
    """Return the numbers (k,) of the samples of a form nearest to points ``at`` (k, d)."""
    from scipy.spatial import cKDTree

    return np.asarray(cKDTree(form.points).query(at)[1], dtype=np.int64)


def _distinct_places(scene: Scene, meetings: Sequence[Meeting]) -> tuple[Floats, Floats, Floats]:
    """Return the places (k, d) of ``meetings``, each once, with the resistance (k,) and the radius (k,) there.

    Curves that end at the same point have one value there, and one way into the surface. Raises SceneError if they have
    different laws, or a radius is not small beside the surface.
    """
    touching = 4 * touching_distance(scene.surface)
    found: list[tuple[Floats, Junction, float]] = []
    for meeting in meetings:
        law = junction_of(scene.junctions, meeting.lower, meeting.higher)
        radius = _radius(scene, meeting)
        for at in meeting.places:
            same = [other for there, other, _ in found if norms((there - at)[None])[0] <= touching]
            if any(other != law for other in same):
                raise SceneError(f"curves that meet a surface at one point, {place(at)}, need one junction law.")
            found += [] if same else [(at, law, radius)]
    values = np.array([(law.resistance, radius) for _, law, radius in found])
    return np.array([at for at, _, _ in found]), *values.T


def _radius(scene: Scene, meeting: Meeting) -> float:
    """Return the radius of the curve at a ``meeting``; raise SceneError if it is not small beside the other member."""
    radius = junction_of(scene.junctions, meeting.lower, meeting.higher).radius
    size = float(np.ptp(np.asarray(members_of(scene.surface)[meeting.higher].bounds), axis=0).max())
    if radius is None or radius > LARGEST_RADIUS_SHARE * size:
        raise SceneError(
            f"the radius of a junction must be at most a tenth of the largest side of the surface or solid, "
            f"{size:.3g}, got {radius:g}; a thicker rod is a surface or a solid of its own."
        )
    return radius


def _contact_at_points(scene: Scene, surface: Galerkin, curve: Galerkin, meetings: Sequence[Meeting]) -> DiscContact:
    """Return the contact of curves and surfaces that meet at the points of ``meetings``."""
    at, resistance, radius = _distinct_places(scene, meetings)
    nearest = nearest_samples(surface, at)
    frames = normal_frames(surface.sampled.samples.normals_at(nearest)[:, 0])
    mean, spread = mean_over_discs(surface, at, frames, radius)
    sides = [curve.evaluation_matrix(at, side) for side in ("left", "right")] if curve.scene.boundaries else None
    lower = curve.evaluation_matrix(at) if sides is None else (0.5 * (sides[0] + sides[1])).tocsr()
    touching = touching_distance(scene.surface)
    lips, branches = _lips_at(curve, at, touching), _branches_at(curve, at, touching)
    return DiscContact(mean, lower, nearest, resistance, spread, np.ones(len(at)), lips, branches)


def _contact_along_curves(scene: Scene, solid: Galerkin, curves: UnionPart, meetings: Sequence[Meeting]) -> DiscContact:
    """Return the contact of a solid and the curves inside it, at the curves' quadrature points."""
    form, laws = curves.form, np.full((2, len(members_of(scene.surface))), np.nan)
    for meeting in meetings:
        resistance = junction_of(scene.junctions, meeting.lower, meeting.higher).resistance
        laws[:, meeting.lower] = resistance, _radius(scene, meeting)
    element = form.scene.surface.closest_point(form.points).element if len(curves.numbers) > 1 else None
    member = np.asarray(curves.numbers)[np.zeros(len(form.points), dtype=np.int64) if element is None else element]
    rows = np.flatnonzero(np.isfinite(laws[0, member]))
    at, (resistances, radius) = form.points[rows], laws[:, member[rows]]
    mean, spread = mean_over_discs(solid, at, form.sampled.samples.normals_at(rows), radius)
    weights = form.point_weights[rows]
    return DiscContact(mean, form.evaluation_matrix(at), nearest_samples(solid, at), resistances, spread, weights)


def near_boundary_warnings(scene: Scene, solid: Galerkin) -> tuple[str, ...]:
    """Return a warning if a curve in a ``solid`` runs within a spacing of its boundary, else ()."""
    from scipy.spatial import cKDTree

    inside = [meeting for meeting in meetings_of(scene.surface) if meeting.how == "inside"]
    if not inside:
        return ()
    samples, lattice = solid.sampled.boundary, solid.sampled.lattice
    tree = cKDTree(lattice.to_scene(samples.points[samples.on_rim]))
    for meeting in inside:
        at = meeting.places
        near = tree.query(at)[0] < lattice.spacing
        for end in edges_near(members_of(scene.surface)[meeting.lower], at).values():
            is_far = norms(at - end[0]) > ENDS_SPACINGS * lattice.spacing
            near &= is_far | (tree.query(end[0])[0] > lattice.spacing)
        if near.any():
            return (
                f"Member {meeting.lower} of the union runs within a spacing of the boundary of member "
                f"{meeting.higher} near {place(at[near.argmax()])}, and what flows between them there is off by "
                "some percent; use a smaller spacing, or move it inside.",
            )
    return ()


def end_flow_warnings(
    scene: Scene, parts: Sequence[UnionPart], contacts: Mapping[tuple[int, int], DiscContact]
) -> Iterator[str]:
    """Yield a warning if a velocity that is not conservative flows through an end of a curve that meets a surface."""
    terms = scene.problem.terms()
    if terms.velocity is None or terms.conservative:
        return
    for (_, low), contact in contacts.items():
        form, ends = parts[low].form, np.array([at[0] for at in contact.branches if len(at) == 1], dtype=np.int64)
        speed: Any = form.terms_of_scene.outward_speed
        flowing = ends[speed[ends] != 0]
        if len(flowing):
            where = form.sampled.lattice.to_scene(form.sampled.boundary.points[flowing[:1]])[0]
            yield (
                f"The velocity flows through the end of a curve near {place(where)}, where it meets a surface, and "
                "what it takes along is not exchanged with the surface; give conservative=True."
            )


def _lips_at(curve: Galerkin, at: Floats, touching: float) -> list[tuple[int, Ints]]:
    """Return for those of the points ``at`` (k, d) where ends of curves are tied its number and the samples of lips."""
    points, found = curve.sampled.lattice.to_scene(curve.sampled.boundary.points), []
    for tie in conditions_with_law(curve.conditions, Tie):
        for lips in np.stack(tie.sides, axis=1):
            near = norms(at - points[lips[0]])
            found += [(int(np.argmin(near)), lips)] if near.min() <= 100 * touching else []
    return found


def _branches_at(curve: Galerkin, at: Floats, touching: float) -> list[Ints]:
    """Return for each of the points ``at`` (k, d) the samples at which branches of the curves end there."""
    points = curve.sampled.lattice.to_scene(curve.sampled.boundary.points)
    return [np.flatnonzero(norms(points - one) <= 100 * touching) for one in at]
