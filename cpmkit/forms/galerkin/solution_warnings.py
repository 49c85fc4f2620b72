"""Warnings on any solution: jumps between values given on boundaries, unresolved layers, pieces and folds."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations, product
from typing import TYPE_CHECKING

import numpy as np

from cpmkit.errors import place
from cpmkit.forms.form_records import LARGE_ERRORS
from cpmkit.forms.galerkin.conditions.condition_terms import ConditionTerms
from cpmkit.forms.galerkin.conditions.imposed_conditions import conditions_with_law
from cpmkit.forms.galerkin.dof_map import ISOLATED_SPACINGS, DofMap
from cpmkit.grid.lattice import Lattice
from cpmkit.mesh.mesh import CellGeometry, Mesh
from cpmkit.meshing.curved_from_points import boundary_vertices
from cpmkit.scene.data import evaluate_data
from cpmkit.scene.laws import Value
from cpmkit.scene.scene import Scene
from cpmkit.types import SIDES, Floats, Ints

if TYPE_CHECKING:
    from cpmkit.forms.galerkin.resolution import NormalSpread

#: Values at a crossing that differ by less than this share of their size count as equal: vertices are not exactly
#: there.
DIFFERENT_SHARE = 0.01
#: A layer of width a / v . b is reported where it is narrower than this share of the spacing.
OUTFLOW_LAYER_SPACINGS = 0.25
#: Folds are reported if the unresolved share of the area (:attr:`NormalSpread.unresolved_share`) exceeds this.
FOLDED_SHARE = 0.03
#: Nodes with several unknowns are reported where these are more than this share of the nodes.
COPIES_SHARE = 0.5


def crossing_warnings(scene: Scene, mesh: Mesh, lattice: Lattice) -> Iterator[str]:
    """Yield a warning if boundaries on a surface give different values at their first common vertex: u jumps there.

    On a sphere at h = 0.2 and 0.1, two great circles with the values 1 and 2 left errors of 0.3 within half a spacing
    of the crossing, 0.05 from one to two spacings away, 0.006 at four and 0.001 at eight. The ``mesh`` is relative to
    the lattice's origin.
    """
    if mesh.manifold_dim == 1 or not len(mesh.cut):
        return
    jumps = []
    for pair in combinations(np.unique(mesh.owner[~mesh.beyond_tip]).tolist(), 2):
        shared = np.intersect1d(boundary_vertices(mesh, pair[0]), boundary_vertices(mesh, pair[1]))[:1]
        if not len(shared):
            continue
        where = lattice.to_scene(mesh.vertices[shared])
        first, second = (_given_values(scene, k, where) for k in pair)
        jump = max((_largest_magnitude(a - b) for a, b in product(first, second)), default=0.0)
        if jump > DIFFERENT_SHARE * max(_largest_datum(scene, mesh, lattice, k) for k in pair):
            jumps.append((pair, where[0], jump))
    if jumps:
        pair, where, jump = jumps[0]
        first, second = (scene.boundaries[k].name for k in pair)
        more = f" and {len(jumps) - 1} more pairs" if len(jumps) > 1 else ""
        yield (
            f"Boundaries {first!r} and {second!r}{more} cross with different values near {place(where)}: do not trust "
            "the solution just there; a smaller spacing narrows the spot. Within half a spacing of it the solution is "
            f"off by up to a third of their difference, {jump:.3g}, and by a hundredth four spacings away."
        )


def tip_warnings(scene: Scene, mesh: Mesh, lattice: Lattice) -> Iterator[str]:
    """Yield warnings on boundaries that end inside a surface with different values on their sides.

    On a sphere at h = 0.2 and 0.1, an arc with the values 1 and -1 left errors of 0.4 within half a spacing of its
    ends, 0.1 from one to two spacings away and 0.02 at four. The ``mesh`` is relative to the lattice's origin.
    """
    if mesh.manifold_dim == 1:
        return
    for number, boundary in enumerate(scene.boundaries):
        tips, laws = ends_inside(mesh, number), [boundary.condition(side).law for side in SIDES]
        if not len(tips) or not all(isinstance(law, Value) for law in laws):
            continue
        where = lattice.to_scene(mesh.vertices[tips])
        left, right = _given_values(scene, number, where)
        apart = np.abs(left - right).max(axis=1)
        bad = np.flatnonzero(apart > DIFFERENT_SHARE * _largest_datum(scene, mesh, lattice, number))
        if len(bad):
            more = f" and at {len(bad) - 1} more ends" if len(bad) > 2 else " and at its other end" * (len(bad) - 1)
            yield (
                f"Boundary {boundary.name!r} ends near {place(where[bad[0]])}{more} with different values on its "
                "sides: do not trust the solution just there; give both sides one value there, or a smaller spacing. "
                f"Within about a spacing, {lattice.spacing:.2g}, of the end it is off by up to a fifth of their "
                f"difference, {apart[bad[0]]:.3g}."
            )


def ends_inside(mesh: Mesh, number: int) -> Ints:
    """Return the vertices (k,) at which boundary ``number`` ends inside the surface and its continuation begins."""
    own = mesh.cut[(mesh.owner == number) & ~mesh.beyond_tip]
    past = mesh.cut[(mesh.owner == number) & mesh.beyond_tip]
    vertices, count = np.unique(own, return_counts=True)
    return np.intersect1d(vertices[count == 1], past)


def _largest_datum(scene: Scene, mesh: Mesh, lattice: Lattice, number: int) -> float:
    """Return the largest magnitude, at the vertices of boundary ``number``, of the values given on it; else 0."""
    where = lattice.to_scene(mesh.vertices[boundary_vertices(mesh, number)])
    return max(map(_largest_magnitude, _given_values(scene, number, where)), default=0.0)


def _given_values(scene: Scene, number: int, where: Floats) -> list[Floats]:
    """Return the values (k, channels) at ``where`` (k, d) that are given on a boundary, for each side that has some.

    In problems in time the values are those at the start.
    """
    boundary, time = scene.boundaries[number], scene.problem.start_time
    laws = [boundary.condition(side).law for side in SIDES]
    label = f"boundary {boundary.name!r}"
    return [evaluate_data(law.datum, where, scene.channels, label, time) for law in laws if isinstance(law, Value)]


def _largest_magnitude(values: Floats) -> float:
    """Return the largest absolute value; 0 for an empty array."""
    return float(np.abs(values).max(initial=0.0))


def outflow_layer_warnings(terms: ConditionTerms) -> Iterator[str]:
    """Yield warnings where a velocity flows out through a given value, in a layer that the spacing does not resolve."""
    if terms.outward_speed is None:
        return
    spacing = terms.lattice.spacing
    for condition in conditions_with_law(terms.conditions, Value):
        rows = condition.rows
        if not len(rows):
            continue
        cell_numbers = terms.outward_speed[rows] * spacing / terms.a[rows]
        worst = int(cell_numbers.argmax())
        if cell_numbers[worst] * OUTFLOW_LAYER_SPACINGS <= 1:
            continue
        where = place(terms.lattice.to_scene(terms.samples.points[rows[[worst]]])[0])
        width, label = spacing / cell_numbers[worst], condition.label
        yield (
            f"{label[0].upper()}{label[1:]}: the velocity flows out through a value that is given, near {where}; "
            f"where what arrives differs from it u has a layer {width:.2g} wide, which spacing={spacing:g} leaves out; "
            f"use {width / OUTFLOW_LAYER_SPACINGS:.2g} or less to see it."
        )


def resolution_warnings(
    dof_map: DofMap, pieces: tuple[int, Ints], lattice: Lattice, boundaries: Ints, geometry: CellGeometry
) -> Iterator[str]:
    """Yield warnings on isolated pieces, and if cells follow closest points on many nodes with several unknowns.

    ``pieces`` are the number of connected pieces and the piece (n,) of each unknown; ``boundaries`` (b,) the patches of
    the samples on boundaries, where nodes have several unknowns by construction; ``geometry`` is that of the cells.
    """
    count, piece = pieces
    size = np.bincount(piece, minlength=count)
    isolated = np.flatnonzero(size == 1)
    if len(isolated) and count > 1:
        node = dof_map.places[np.flatnonzero(piece == isolated[0])[0]]
        at = place(lattice.to_scene(node))
        yield (
            f"One piece of the manifold is smaller than {ISOLATED_SPACINGS:g} spacings and has one value, near {at}; "
            "a smaller spacing resolves it."
            if len(isolated) == 1
            else f"{len(isolated)} pieces of the manifold are smaller than {ISOLATED_SPACINGS:g} spacings and have one "
            f"value each, the first near {at}; a smaller spacing resolves them."
        )
    low, high = dof_map.nodes.min(axis=0), dof_map.nodes.max(axis=0)
    codes = np.ravel_multi_index((dof_map.nodes - low).T, high - low + 1)
    number = np.unique(codes, return_inverse=True)[1]
    copies = np.bincount(number) - 1
    copies[number[dof_map.unknowns[boundaries]]] = 0
    if geometry == "closest_point" and copies.sum() > COPIES_SHARE * len(copies):
        yield (
            f"{copies.sum()} of {dof_map.size} splines are copies at nodes that several parts of the manifold share: "
            "sheets of it are near each other, or its triangulation is torn; use a smaller spacing."
        )


def fold_warnings(spread: NormalSpread, lattice: Lattice) -> Iterator[str]:
    """Yield a warning if much of the manifold is thin, folded or creased on the lattice."""
    if spread.unresolved_share > FOLDED_SHARE:
        yield (
            f"{LARGE_ERRORS}, and fall slowly, where the manifold is thin, folded or creased on this lattice; use a "
            f"smaller spacing. {spread.unresolved_share:.0%} of it lies on splines that see it from several sides, "
            f"most near {place(lattice.to_scene(spread.place))}; at a fold up to three spacings of the way along the "
            "manifold may be missing."
        )
