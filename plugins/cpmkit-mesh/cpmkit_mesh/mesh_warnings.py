"""Warnings about a mesh: components that touch, creases, edges of three triangles or more."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cpmkit.plugin import Floats, Ints, place
from cpmkit_mesh.box_tree import build_tree, find_nearest
from cpmkit_mesh.chains import components
from cpmkit_mesh.face_geometry import InnerEdges, double_areas, nonmanifold_edges
from cpmkit_mesh.mesh_components import closest_approach

if TYPE_CHECKING:
    from cpmkit_mesh.triangles import TriangleMesh

#: Connected creases shorter than so many spacings, about the width of the band, give no warning: every scan has such.
#: Near them errors are up to 1.9 times those elsewhere, at Nefertiti's folds 1.3 to 3 times.
SHORT_CREASE_SPACINGS = 8.0
#: The length of creases, weighted by the square of their angle over a right one, from which on a warning is given, in
#: square roots of the mesh's area. Largest errors on a sheet folded once: 0.5, 1, 6 and 12 percent of the range for
#: folds of 45, 60, 90 and 120 degrees (0.15, 0.27, 0.61, 1.1). Against finite elements, errors (rms, percent) near such
#: creases and elsewhere, at two spacings: Nefertiti (1.5 to 2.8) 4.3 and 1.6, 2.6 and 1.2; aeroplane (7) 1.0 and 1.8,
#: 1.5 and 0.6; mountain (up to 0.55) 1.1 and 0.9, 0.6 and 0.5; Spot (0.2) 1.2 and 2.6, 0.4 and 2.1; the fish (0.3),
#: once, 1.2 and 0.8. The limit was chosen from these, so they are no test of it.
LONG_CREASE_ROOTS_OF_AREA = 0.6
#: Spacings from a crease up to which the surface is near it, and the random points by which that area is estimated.
NEAR_CREASE_SPACINGS, AREA_POINTS = 2.0, 4096
#: A crease is rounded off by interpolated normals where its radius, the width of the triangles beside it over its
#: angle, is so many spacings. Tubes of 4 to 12 sides, perimeter 2 pi, triangles 0.06 and 0.2 wide, u - u'' = 2 cos s:
#: error (rms) 0.03 to 0.28 for radii of 0.4 to 1.2 spacings, 0.005 to 0.04 for 1.5 to 5.
ROUNDED_CREASE_SPACINGS = 1.5
#: Components that come within so many spacings of each other touch.
TOUCHING_SPACINGS = 0.5


def mesh_warnings(mesh: TriangleMesh) -> tuple[str, ...]:
    """Return warnings that hold at any spacing and in any form: repairs, and several components."""
    count = int(mesh.component.max()) + 1
    several = [f"The mesh has {count} pieces that share no edge; each is solved by itself."] if count > 1 else []
    return (*mesh.repaired.notes, *several)


def closest_point_warnings(mesh: TriangleMesh, spacing: float) -> tuple[str, ...]:
    """Return warnings about touching components, long creases and junctions, where closest points jump.

    ``spacing`` is that of the grid. Places in the sentences are in the coordinates of the mesh as the user gave it,
    before translations.
    """
    return (
        *_touching_warnings(mesh, spacing),
        *_crease_warnings(mesh, spacing),
        *_nonmanifold_warnings(mesh),
    )


def _touching_warnings(mesh: TriangleMesh, spacing: float) -> list[str]:
    """Return a warning if components come within :data:`TOUCHING_SPACINGS` times ``spacing`` or intersect, else []."""
    approach = closest_approach(mesh.vertices, mesh.faces, mesh.component, TOUCHING_SPACINGS * spacing)
    if approach is None:
        return []
    return [
        f"Pieces of the mesh nearly meet, or pass through each other: near {place(approach.place - mesh.shift)} two "
        f"are {approach.distance / spacing:.1g} spacings apart; closest points mix them there, and the solution may be "
        "off by tens of percent nearby; join them into one, or solve on them one by one."
    ]


def _crease_warnings(mesh: TriangleMesh, spacing: float) -> list[str]:
    """Return a warning if the weighted length of creases exceeds :data:`LONG_CREASE_ROOTS_OF_AREA`, else [].

    Weights are the square of the angle over a right one. Connected creases up to :data:`SHORT_CREASE_SPACINGS` times
    ``spacing``, that of the grid, long are left out.
    """
    creases = mesh.inner_edges.take(mesh.inner_edges.angle > np.deg2rad(mesh.crease_angle))
    creases = creases.take(_connected_length(creases) > SHORT_CREASE_SPACINGS * spacing)
    areas = 0.5 * double_areas(mesh.vertices, mesh.faces)
    if creases.length @ (creases.angle / (0.5 * np.pi)) ** 2 <= LONG_CREASE_ROOTS_OF_AREA * np.sqrt(areas.sum()):
        return []
    sharpest = int(np.argmax(creases.angle))
    near_share = _share_near(mesh, creases, areas, NEAR_CREASE_SPACINGS * spacing)
    return [
        "The mesh has creases, near which the solution is less accurate: "
        f"{len(creases.angle)} edges of the mesh turn by more than {mesh.crease_angle:g} degrees, the sharpest by "
        f"{np.rad2deg(creases.angle[sharpest]):.0f} near {_place_of(mesh, creases.ends[sharpest])}, and "
        f"{near_share:.0%} of the surface lies within two spacings of them: "
        + _crease_consequence(mesh.smooth, creases, spacing)
    ]


def _connected_length(creases: InnerEdges) -> Floats:
    """Return (k,) for each of the edges ``creases`` the total length of the creases connected with it and its own."""
    used, node = np.unique(creases.ends, return_inverse=True)
    node = node.reshape(-1, 2)
    component = components(node, len(used))[node[:, 0]]
    length: Floats = np.bincount(component, creases.length)
    return length[component]


def _share_near(mesh: TriangleMesh, creases: InnerEdges, areas: Floats, distance: float) -> float:
    """Return the share of the area within ``distance`` of ``creases``, estimated by random points of fixed seed.

    ``areas`` (m,) are those of the triangles.
    """
    rng = np.random.default_rng(0)
    faces = mesh.faces[rng.choice(len(areas), AREA_POINTS, p=areas / areas.sum())]
    points = np.einsum("nc,ncd->nd", rng.dirichlet(np.ones(3), AREA_POINTS), mesh.vertices[faces])
    tree = build_tree(mesh.vertices[creases.ends[:, [0, 1, 1]]])
    return float(np.mean(find_nearest(tree, points).distance <= distance))


def _crease_consequence(smooth: bool, creases: InnerEdges, spacing: float) -> str:
    """Return the end of the warning about ``creases``: their effect on a solution at ``spacing``, and a remedy if any.

    ``smooth`` says whether closest points follow interpolated normals.
    """
    radius = creases.width / creases.angle
    order = np.argsort(radius)
    passed = np.cumsum(creases.length[order])
    typical = float(radius[order][np.searchsorted(passed, 0.5 * passed[-1])])
    harm = "the solution may be off by several percent, at worst by tens"
    if not smooth:
        return (
            f"nearest points of flat triangles jump there, and at any spacing {harm}; closest = 'smooth' rounds "
            "creases off, which helps where the triangles beside them are narrow and the spacing is half their width."
        )
    if typical < ROUNDED_CREASE_SPACINGS * spacing:
        return (
            f"most are too narrow for the spacing, and {harm}; below {typical / ROUNDED_CREASE_SPACINGS:.2g} most are "
            "rounded off."
        )
    return "most are rounded off over the triangles beside them, and the solution may be off by some percent nearby."


def _nonmanifold_warnings(mesh: TriangleMesh) -> list[str]:
    """Return a warning if the mesh has edges of three triangles or more, else []."""
    edges = nonmanifold_edges(mesh.faces, mesh.adjacency)
    if not len(edges):
        return []
    return [
        f"{len(edges)} edges of the mesh are shared by three or more triangles, the first near "
        f"{_place_of(mesh, edges[0])}: the surface branches there, u is continuous, and the form 'collocation' "
        "may be off by tens of percent; use the form 'galerkin', or separate the sheets if they should not meet."
    ]


def _place_of(mesh: TriangleMesh, ends: Ints) -> str:
    return place(mesh.vertices[ends].mean(axis=0) - mesh.shift)
