"""Discretisation of a scene on a union of members of different dimension."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from cpmkit.forms.galerkin.conditions.imposed_conditions import ClosedManifoldError, conditions_with_law
from cpmkit.forms.galerkin.form import Galerkin
from cpmkit.forms.galerkin.options import GalerkinOptions
from cpmkit.forms.galerkin.unions.junctions import ON_SPACINGS, Contact, PointContact, mean_over_circles
from cpmkit.forms.galerkin.unions.part_scenes import scenes_by_dimension, without_edge
from cpmkit.forms.galerkin.unions.union_form import GalerkinUnion, UnionPart
from cpmkit.forms.options import Options
from cpmkit.grid.lattice import lattice_of
from cpmkit.manifold.abilities import members_of
from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.mixed_dimension import Meeting, meetings_of
from cpmkit.manifold.vector_algebra import norms
from cpmkit.scene.junction import JunctionLaw, check_radii, junction_of
from cpmkit.scene.scene import Scene
from cpmkit.types import Floats, Ints, Progress

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
        form, is_closed = _discretize_part(own, options, progress, discretize)
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
    points = lattice.to_scene(boundary.points)
    for meeting in meetings_of(scene.surface):
        if not {meeting.lower, meeting.higher} & {*numbers} or not len(points):
            continue
        if meeting.how == "points":
            near = np.min([norms(points - at) for at in meeting.places], axis=0)
            on |= boundary.on_rim & (near <= ON_SPACINGS * lattice.spacing)
        elif meeting.higher in numbers and not form.space.splines.samples.codim:
            on |= norms(members[meeting.lower].closest_point(points).points - points) <= ON_SPACINGS * lattice.spacing
    return np.flatnonzero(on)


def _contact(scene: Scene, high: UnionPart, low: UnionPart) -> Contact | None:
    """Return the contact of two parts whose dimensions differ by one; None if they do not touch."""
    form = high.form
    if form.space.splines.samples.codim:
        cuts = conditions_with_law(form.conditions, JunctionLaw)
        rows = np.concatenate([np.zeros(0, dtype=np.int64), *(cut.all_rows for cut in cuts)])
    else:
        rows = high.taken
    if high.dim != low.dim + 1 or not len(rows):
        return None
    points = form.sampled.lattice.to_scene(form.sampled.boundary.points[rows])
    numbers = [_member_at(part, points) for part in (low, high)]
    resistance = np.empty(len(rows))
    for pair in np.unique(np.stack(numbers), axis=1).T:
        at = (numbers[0] == pair[0]) & (numbers[1] == pair[1])
        resistance[at] = junction_of(scene.junctions, *pair.tolist()).resistance
    return Contact(rows, low.form.evaluation_matrix(points), resistance)


def _member_at(part: UnionPart, points: Floats) -> Ints:
    """Return the number (n,) in the union of the member of a ``part`` that is nearest to each of ``points`` (n, d)."""
    source = LocalSource(part.form.scene.surface, np.zeros(points.shape[1]))
    element = source.closest_point(points).element
    own = np.zeros(len(points), dtype=np.int64) if len(part.numbers) == 1 or element is None else element
    return np.asarray(part.numbers)[own]


def _point_contact(scene: Scene, surface: Galerkin, curve: Galerkin, meetings: Sequence[Meeting]) -> PointContact:
    """Return the contact of curves and surfaces that meet at the points of ``meetings``."""
    at = np.concatenate([meeting.places for meeting in meetings])
    laws = [junction_of(scene.junctions, meeting.lower, meeting.higher) for meeting in meetings]
    counts = [len(meeting.places) for meeting in meetings]
    resistance = np.repeat([law.resistance for law in laws], counts)
    radius = np.repeat([law.radius for law in laws], counts).astype(np.float64)
    mean, nearest = mean_over_circles(surface, at, radius)
    sides = [curve.evaluation_matrix(at, side) for side in ("left", "right")] if curve.scene.boundaries else None
    lower = curve.evaluation_matrix(at) if sides is None else (0.5 * (sides[0] + sides[1])).tocsr()
    return PointContact(mean, lower, nearest, resistance, radius)
