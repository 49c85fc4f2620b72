"""Discretisation of a scene on a union of members of different dimension."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from cpmkit.forms.galerkin.conditions.imposed_conditions import ClosedManifoldError, conditions_with_law
from cpmkit.forms.galerkin.form import Galerkin
from cpmkit.forms.galerkin.options import GalerkinOptions
from cpmkit.forms.galerkin.unions.disc_contacts import disc_contacts
from cpmkit.forms.galerkin.unions.junctions import ON_SPACINGS, Contact
from cpmkit.forms.galerkin.unions.part_scenes import loop_of_union, scenes_by_dimension, without_edge
from cpmkit.forms.galerkin.unions.union_form import GalerkinUnion
from cpmkit.forms.galerkin.unions.union_parts import UnionPart
from cpmkit.forms.options import Options
from cpmkit.grid.lattice import lattice_of
from cpmkit.manifold.abilities import HasSkin, members_of
from cpmkit.manifold.meetings import is_near, meetings_of
from cpmkit.manifold.vector_algebra import norms
from cpmkit.scene.edge_conditions import EdgeLoopError
from cpmkit.scene.junction import JunctionLaw, check_radii, junction_of
from cpmkit.scene.scene import Scene
from cpmkit.types import Ints, Progress

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
        form = replace(form, junction_edge=_taken_edge(scene, numbers, form))
        part = UnionPart(
            numbers,
            form,
            slice(unknowns, unknowns + form.size),
            slice(points, points + form.sampled.interior),
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
    return GalerkinUnion(scene, options, tuple(parts), contacts, disc_contacts(scene, parts))


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
        elif meeting.how == "along" and meeting.higher in numbers and not form.space.splines.samples.codim:
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
