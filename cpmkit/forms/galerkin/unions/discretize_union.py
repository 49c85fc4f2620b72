"""Discretisation of a scene on a union of members of different dimension."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from cpmkit.errors import SceneError
from cpmkit.errors import place as place_in_words
from cpmkit.forms.galerkin.conditions.imposed_conditions import ClosedManifoldError, Tie, conditions_with_law
from cpmkit.forms.galerkin.form import Galerkin
from cpmkit.forms.galerkin.options import GalerkinOptions
from cpmkit.forms.galerkin.unions.junctions import ON_SPACINGS, Contact, PointContact, mean_over_circles
from cpmkit.forms.galerkin.unions.part_scenes import loop_of_union, scenes_by_dimension, without_edge
from cpmkit.forms.galerkin.unions.union_form import GalerkinUnion
from cpmkit.forms.galerkin.unions.union_parts import UnionPart
from cpmkit.forms.options import Options
from cpmkit.grid.lattice import lattice_of
from cpmkit.manifold.abilities import HasSkin, members_of
from cpmkit.manifold.meetings import Meeting, is_near, meetings_of, touching_distance
from cpmkit.manifold.vector_algebra import norms
from cpmkit.scene.edge_conditions import EdgeLoopError
from cpmkit.scene.junction import Junction, JunctionLaw, check_radii, junction_of
from cpmkit.scene.scene import Scene
from cpmkit.types import Floats, Ints, Progress

#: The radius of a curve that meets a surface is at most this share of the surface's largest side: the part of the
#: surface inside the radius, which stays, then changes values by a few percent at most.
LARGEST_RADIUS_SHARE = 0.1
#: The discretisation of a scene of one dimension.
Discretize = Callable[[Scene, Options[GalerkinOptions], Progress], Galerkin]


def discretize_union(
    scene: Scene, options: Options[GalerkinOptions], progress: Progress, discretize: Discretize
) -> GalerkinUnion:
    """Return the discretisation of a scene on a union of members of different dimension, each by ``discretize``.

    All lattices have the same nodes. Raises SceneError if a junction has no law, and the errors of ``discretize``.
    """
    check_radii(scene.surface, scene.junctions)
    options = replace(options, origin=lattice_of(scene.surface, options.spacing, options.origin).origin)
    parts: list[UnionPart] = []
    for numbers, own in scenes_by_dimension(scene):
        name = f"member{'s' * (len(numbers) > 1)} {' and '.join(map(str, numbers))} of the union,"
        lattice_of(own.surface, options.spacing, name=name)
        try:
            form, is_closed = _discretize_part(own, options, progress, discretize)
        except EdgeLoopError as error:
            given = scene.edge if isinstance(scene.edge, Mapping) else ()
            raise error.renumber(given, partial(loop_of_union, scene.surface, numbers)) from None
        unknowns, points = (parts[-1].unknowns.stop, parts[-1].points.stop) if parts else (0, 0)
        taken = _taken_edge(scene, numbers, form)
        part = UnionPart(
            numbers,
            form,
            slice(unknowns, unknowns + form.size),
            slice(points, points + form.sampled.interior),
            taken,
            is_closed,
        )
        parts.append(part.without_taken_edge())
    if all(part.is_closed for part in parts):
        raise ClosedManifoldError("the members are closed and have no edge, so `edge` cannot be given; leave it out.")
    contacts = {}
    for high, low in zip(range(1, len(parts)), range(len(parts)), strict=False):
        contact = _contact(scene, parts[high], parts[low])
        if contact is not None:
            contacts[high, low] = contact
    dims = [part.dim for part in parts]
    at_points = [meeting for meeting in meetings_of(scene.surface) if meeting.how == "points"]
    points_of = {}
    if at_points:
        high, low = dims.index(2), dims.index(1)
        if scene.has_tensor:
            raise SceneError(
                "where a curve meets a surface at a point, the diffusivity must be a number or a function that returns "
                "numbers, got a tensor."
            )
        points_of[high, low] = _point_contact(scene, parts[high].form, parts[low].form, at_points)
    return GalerkinUnion(scene, options, tuple(parts), contacts, points_of)


def _discretize_part(
    scene: Scene, options: Options[GalerkinOptions], progress: Progress, discretize: Discretize
) -> tuple[Galerkin, bool]:
    """Return the form of a scene on members of one dimension, and whether they have no edge for its conditions."""
    try:
        return discretize(scene, options, progress), False
    except ClosedManifoldError:
        return discretize(without_edge(scene), options, progress), True


def _taken_edge(scene: Scene, numbers: Sequence[int], form: Galerkin) -> Ints:
    """Return the samples (k,) on the edge of the members ``numbers`` that lie on other members."""
    boundary, lattice, members = form.sampled.boundary, form.sampled.lattice, members_of(scene.surface)
    on = np.zeros(len(boundary), dtype=bool)
    points, reach = lattice.to_scene(boundary.points), ON_SPACINGS * lattice.spacing
    for meeting in meetings_of(scene.surface):
        if not {meeting.lower, meeting.higher} & {*numbers} or not len(points):
            continue
        if meeting.how == "points":
            near = np.min([norms(points - at) for at in meeting.places], axis=0)
            on |= boundary.on_rim & (near <= reach)
        elif meeting.how != "within" and meeting.higher in numbers and not form.space.splines.samples.codim:
            skin = members[meeting.higher]
            feet = skin.skin.closest_point(points) if isinstance(skin, HasSkin) else None
            at = points if feet is None else np.where((feet.distance <= reach)[:, None], feet.points, points)
            on |= is_near(members[meeting.lower], at, scene.surface)
    return np.flatnonzero(on)


def _contact(scene: Scene, high: UnionPart, low: UnionPart) -> Contact | None:
    """Return the contact of two parts whose dimensions differ by one; None if they do not touch."""
    form = high.form
    cuts = conditions_with_law(form.conditions, JunctionLaw)
    rows = np.concatenate([np.zeros(0, dtype=np.int64), *(cut.all_rows for cut in cuts)])
    if not form.space.splines.samples.codim:
        rows = np.concatenate([high.taken, rows[form.sampled.boundary.owner[rows] >= 0]])
    if high.dim != low.dim + 1 or not len(rows):
        return None
    points = form.sampled.lattice.to_scene(form.sampled.boundary.points[rows])
    numbers = []
    for part in (low, high):  # the member of each that is nearest to the points
        element = part.form.scene.surface.closest_point(points).element
        alone = len(part.numbers) == 1 or element is None
        numbers.append(np.asarray(part.numbers)[np.zeros(len(points), dtype=np.int64) if alone else element])
    resistance = np.empty(len(rows))
    for pair in np.unique(np.stack(numbers), axis=1).T:
        at = (numbers[0] == pair[0]) & (numbers[1] == pair[1])
        resistance[at] = junction_of(scene.junctions, *pair.tolist()).resistance
    return Contact(rows, low.form.evaluation_matrix(points), resistance)


def _distinct_places(scene: Scene, meetings: Sequence[Meeting]) -> tuple[Floats, Floats, Floats]:
    """Return the places (k, d) of ``meetings``, each once, with the resistance (k,) and the radius (k,) there.

    Curves that end at the same point have one value there, and one way into the surface. Raises SceneError if they have
    different laws, or a radius is not small beside the surface.
    """
    touching = 4 * touching_distance(scene.surface)
    found: list[tuple[Floats, Junction]] = []
    for meeting in meetings:
        law = junction_of(scene.junctions, meeting.lower, meeting.higher)
        size = float(np.ptp(np.asarray(members_of(scene.surface)[meeting.higher].bounds), axis=0).max())
        if law.radius is None or law.radius > LARGEST_RADIUS_SHARE * size:
            raise SceneError(
                f"the radius of a junction must be at most a tenth of the surface's largest side, {size:.3g}, got "
                f"{law.radius:g}; a thicker rod is a surface or a solid of its own."
            )
        for at in meeting.places:
            same = [other for place, other in found if norms((place - at)[None])[0] <= touching]
            if any(other != law for other in same):
                raise SceneError(
                    f"curves that meet a surface at one point, {place_in_words(at)}, need one junction law."
                )
            found += [] if same else [(at, law)]
    laws = [law for _, law in found]
    values = [(law.resistance, law.radius) for law in laws]
    return np.array([at for at, _ in found]), *np.array(values, dtype=np.float64).T


def _point_contact(scene: Scene, surface: Galerkin, curve: Galerkin, meetings: Sequence[Meeting]) -> PointContact:
    """Return the contact of curves and surfaces that meet at the points of ``meetings``."""
    at, resistance, radius = _distinct_places(scene, meetings)
    mean, nearest = mean_over_circles(surface, at, radius)
    sides = [curve.evaluation_matrix(at, side) for side in ("left", "right")] if curve.scene.boundaries else None
    lower = curve.evaluation_matrix(at) if sides is None else (0.5 * (sides[0] + sides[1])).tocsr()
    return PointContact(mean, lower, nearest, resistance, radius, _lips_at(curve, at, touching_distance(scene.surface)))


def _lips_at(curve: Galerkin, at: Floats, touching: float) -> list[tuple[int, Ints]]:
    """Return for those of the points ``at`` (k, d) where ends of curves are tied its number and the samples of lips."""
    points, found = curve.sampled.lattice.to_scene(curve.sampled.boundary.points), []
    for tie in conditions_with_law(curve.conditions, Tie):
        for lips in np.stack(tie.sides, axis=1):
            near = norms(at - points[lips[0]])
            found += [(int(np.argmin(near)), lips)] if near.min() <= 100 * touching else []
    return found
