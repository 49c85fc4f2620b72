"""What a scene gives must have an effect: edges that are there, conditions that are what they say, one diffusivity."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from cpmkit.errors import InputError, ResolutionError, SceneError, place
from cpmkit.forms.collocation.ghosts.edge import EDGE_CONDITION
from cpmkit.forms.collocation.ghosts.transmission_ghosts import check_conductivities
from cpmkit.forms.collocation.layout import Layout
from cpmkit.mesh.mixed_cells import with_corners
from cpmkit.mesh.quadratic_cells import outward_edges
from cpmkit.protocols import SIDES, ClosestPointSource, Floats, HasMesh
from cpmkit.runtime.arrays import whole
from cpmkit.scene.conditions import Condition, same_condition
from cpmkit.scene.edge_conditions import edge_condition
from cpmkit.scene.laws import Interface, Mixed, beta_at, is_zero_neumann
from cpmkit.scene.scene import Scene

#: The dimension of a solid in space.
SPACE_DIM = 3
#: An edge of a mesh is asked this share of a cell past it.
PAST_EDGE_CELLS = 0.05


def check_used(scene: Scene, layout: Layout) -> None:
    """Refuse what a scene gives and the layout does not use; no closest point is asked for unless something is refused.

    Raises
    ------
    SceneError, ResolutionError
        For a condition on an edge that is not there, or too short for the spacing, and for conductivities that are not
        those of the problem.
    InputError
        For a mixed law whose beta vanishes.
    """
    _check_edges(scene, layout)
    for what, condition, points in _places(scene, layout):
        law = condition.law
        if isinstance(law, Mixed) and len(points) and not np.any(beta_at(law, points, what)):
            kind = condition.kind.capitalize()
            raise InputError(f"beta of {kind} of {what} is zero at all {len(points)} points; use Neumann.")
    diffusivity = scene.problem.terms().diffusivity
    for boundary, frame in zip(scene.boundaries, layout.boundaries.side_views, strict=True):
        across = boundary.condition("left").law
        if isinstance(across, Interface):
            check_conductivities(f"boundary {boundary.name!r}", across, diffusivity, frame, layout.lattice)


def _check_edges(scene: Scene, layout: Layout) -> None:
    met = np.unique(layout.band.feet.edge[layout.band.feet.edge >= 0]).tolist()
    if isinstance(scene.edge, Mapping):
        missing = sorted({whole(loop, "a key of `edge`, the number of a loop,") for loop in scene.edge} - set(met))
        given = f"`edge` gives a condition for loop {missing[0]}" if missing else ""
    else:
        no_flux = all(is_zero_neumann(one.law) for one in scene.edge_conditions)
        missing, given = ([] if met or no_flux else [0]), "`edge` gives a condition"
    if not missing:
        return
    spacing, known = layout.lattice.spacing, _loops(scene.surface, layout.lattice.spacing)
    loop_numbers = sorted({*met, *(known or ())})
    loops_named = f"its loops are {', '.join(map(str, loop_numbers))}" if loop_numbers else "it is closed"
    if known is None:
        raise SceneError(
            f"{given}, which the manifold has not at spacing={spacing:g}: {loops_named} as far as the nodes tell; "
            "leave it out, or use a smaller spacing if the edge is shorter than a few of these."
        )
    if missing[0] in known or (known and not isinstance(scene.edge, Mapping)):
        where = place(known.get(missing[0], next(iter(known.values()))))
        raise ResolutionError(
            f"{given}, an edge too short for spacing={spacing:g}: near {where} no node lies past it, and the "
            "condition would have no effect; use a smaller spacing, or leave it out."
        )
    raise SceneError(f"{given}, which the manifold has not: {loops_named}; leave it out, or correct the number.")


def _loops(surface: ClosestPointSource, spacing: float) -> dict[int, Floats] | None:
    """Return a point (d,) on each edge loop, as a mesh of the surface shows them; None where there is none to ask."""
    if not isinstance(surface, HasMesh) or surface.manifold_dim == surface.dim == SPACE_DIM:
        return None
    points, cells = surface.mesh(spacing)
    triangles, segments = with_corners(cells, 3), with_corners(cells, 2)
    edges = outward_edges(points, triangles)
    single = np.flatnonzero(edges.outward.any(axis=1))
    a, b = points[edges.ends[single, 0]], points[edges.ends[single, 1]]
    beyond = [0.5 * (a + b) + PAST_EDGE_CELLS * np.linalg.norm(b - a, axis=1, keepdims=True) * edges.outward[single]]
    ends = np.concatenate([segments, segments[:, ::-1]])
    ends = ends[np.bincount(segments.ravel(), minlength=len(points))[ends[:, 0]] == 1]
    beyond.append(points[ends[:, 0]] + PAST_EDGE_CELLS * (points[ends[:, 0]] - points[ends[:, 1]]))
    feet = surface.closest_point(np.concatenate(beyond))
    loops, first = np.unique(feet.edge, return_index=True)
    return {int(loop): feet.points[row] for loop, row in zip(loops, first, strict=True) if loop >= 0}


def _places(scene: Scene, layout: Layout) -> Iterator[tuple[str, Condition, Floats]]:
    """Yield each condition with its name and the points (n, d) at which it is read, in the scene's coordinates."""
    to_scene, feet = layout.lattice.to_scene, layout.band.feet
    for boundary, seen, ghosts in zip(scene.boundaries, layout.boundaries.side_views, layout.ghosts, strict=True):
        foot = seen.foot[np.searchsorted(seen.rows, ghosts.nodes)]
        if same_condition(boundary.condition("left"), boundary.condition("right")):
            yield f"boundary {boundary.name!r}", boundary.condition("left"), to_scene(foot)
            continue
        for side in SIDES:
            carried = ghosts.carries_left == (side == "left")
            yield f"boundary {boundary.name!r}", boundary.condition(side), to_scene(foot[carried])
    loops = np.unique(feet.edge[feet.edge >= 0]).tolist()
    conditions = [edge_condition(scene.edge, loop) for loop in loops]
    for condition in {id(condition): condition for condition in conditions}.values():
        chosen = [loop for loop, one in zip(loops, conditions, strict=True) if one is condition]
        yield EDGE_CONDITION, condition, to_scene(feet.points[np.isin(feet.edge, chosen)])
