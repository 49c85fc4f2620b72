"""What about a mesh may spoil a solution on it: pieces that meet, creases, edges at which more than two sheets meet."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cpmkit.plugin import Floats, Ints, place
from cpmkit_mesh.chains import components
from cpmkit_mesh.directions import doubled_areas
from cpmkit_mesh.folds import Folds, crowded_edges
from cpmkit_mesh.pieces import closest_meeting
from cpmkit_mesh.tree import build_tree, nearest

if TYPE_CHECKING:
    from cpmkit_mesh.triangles import TriangleMesh

#: Connected creases shorter than so many spacings, about the width of the band, are left out: with them every scan
#: would be reported. Beside them errors are up to 1.9 times those elsewhere, at Nefertiti's folds 1.3 to 3 times.
SHORT_CREASE_SPACINGS = 8.0
#: So many square roots of the mesh's area of creases, weighed by the square of their angle over a right one, are worth
#: a warning. Largest errors on a sheet folded once: 0.5, 1, 6 and 12 percent of the range for folds of 45, 60, 90 and
#: 120 degrees (0.15, 0.27, 0.61, 1.1). Against finite elements, errors (rms, percent) near such creases and elsewhere,
#: at two spacings: Nefertiti (1.5 to 2.8) 4.3 and 1.6, 2.6 and 1.2; aeroplane (7) 1.0 and 1.8, 1.5 and 0.6; mountain
#: (up to 0.55) 1.1 and 0.9, 0.6 and 0.5; Spot (0.2) 1.2 and 2.6, 0.4 and 2.1; the fish (0.3), once, 1.2 and 0.8. The
#: limit was set between these, so they do not test it.
LONG_CREASE_ROOTS_OF_AREA = 0.6
#: Spacings from a crease up to which the surface counts as beside it, and points by which its area is measured.
BESIDE_CREASE_SPACINGS, AREA_POINTS = 2.0, 4096
#: A crease is rounded off by interpolated normals where its radius, the width of the triangles beside it over its
#: angle, is so many spacings. Tubes of 4 to 12 sides, perimeter 2 pi, triangles 0.06 and 0.2 wide, u - u'' = 2 cos s:
#: error (rms) 0.03 to 0.28 for radii of 0.4 to 1.2 spacings, 0.005 to 0.04 for 1.5 to 5.
ROUNDED_CREASE_SPACINGS = 1.5
#: Pieces that come within so many spacings of each other meet.
MEETING_PIECES_SPACINGS = 0.5


def mesh_warnings(mesh: TriangleMesh) -> tuple[str, ...]:
    """Return what was changed in a mesh, its number of pieces, and where it branches, in the user's coordinates."""
    count = int(mesh.piece.max()) + 1
    apart = [f"The mesh has {count} pieces that share no edge; each is solved by itself."] if count > 1 else []
    return (*mesh.notes, *apart, *_crowded_edge_sentences(mesh))


def closest_point_warnings(mesh: TriangleMesh, spacing: float) -> tuple[str, ...]:
    """Return one sentence for each sort of places near which closest points jump, places in the user's coordinates."""
    return (
        *_meeting_pieces_sentences(mesh, spacing),
        *_crease_sentences(mesh, spacing),
    )


def _meeting_pieces_sentences(mesh: TriangleMesh, spacing: float) -> list[str]:
    meeting = closest_meeting(mesh.vertices, mesh.faces, mesh.piece, MEETING_PIECES_SPACINGS * spacing)
    if meeting is None:
        return []
    return [
        f"Pieces of the mesh meet or pass through each other: near {place(meeting.place - mesh.shift)} two are "
        f"{meeting.distance / spacing:.1g} spacings apart; closest points mix them there, and the solution may be off "
        "by tens of percent nearby; join them into one, or solve on them one by one."
    ]


def _crease_sentences(mesh: TriangleMesh, spacing: float) -> list[str]:
    creases = mesh.folds.take(mesh.folds.angle > np.deg2rad(mesh.crease_angle))
    creases = creases.take(_connected_length(creases) > SHORT_CREASE_SPACINGS * spacing)
    areas = 0.5 * doubled_areas(mesh.vertices, mesh.faces)
    if creases.length @ (creases.angle / (0.5 * np.pi)) ** 2 <= LONG_CREASE_ROOTS_OF_AREA * np.sqrt(areas.sum()):
        return []
    sharpest = int(np.argmax(creases.angle))
    beside = _share_beside(mesh, creases, areas, BESIDE_CREASE_SPACINGS * spacing)
    return [
        "The mesh has creases, beside which the solution is less accurate: "
        f"{len(creases.angle)} edges of the mesh turn by more than {mesh.crease_angle:g} degrees, the sharpest by "
        f"{np.rad2deg(creases.angle[sharpest]):.0f} near {_near(mesh, creases.ends[sharpest])}, and "
        f"{beside:.0%} of the surface lies within two spacings of them: " + _consequence(mesh.smooth, creases, spacing)
    ]


def _connected_length(creases: Folds) -> Floats:
    """Return for each edge the length of all that hang together with it."""
    used, node = np.unique(creases.ends, return_inverse=True)
    node = node.reshape(-1, 2)
    piece = components(node, len(used))[node[:, 0]]
    length: Floats = np.bincount(piece, creases.length)
    return length[piece]


def _share_beside(mesh: TriangleMesh, creases: Folds, areas: Floats, distance: float) -> float:
    """Return the share of the surface that lies within ``distance`` of the creases, from random points."""
    rng = np.random.default_rng(0)
    faces = mesh.faces[rng.choice(len(areas), AREA_POINTS, p=areas / areas.sum())]
    points = np.einsum("nc,ncd->nd", rng.dirichlet(np.ones(3), AREA_POINTS), mesh.vertices[faces])
    tree = build_tree(mesh.vertices[creases.ends[:, [0, 1, 1]]])
    return float(np.mean(nearest(tree, points).distance <= distance))


def _consequence(smooth: bool, creases: Folds, spacing: float) -> str:
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


def _crowded_edge_sentences(mesh: TriangleMesh) -> list[str]:
    crowded = crowded_edges(mesh.faces, mesh.adjacency)
    if not len(crowded):
        return []
    return [
        f"{len(crowded)} edges of the mesh are shared by three or more triangles, the first near "
        f"{_near(mesh, crowded[0])}: the surface branches there, the form 'galerkin' is of first order nearby, and the "
        "form 'collocation' may be off by tens of percent; part the sheets if they should not meet."
    ]


def _near(mesh: TriangleMesh, ends: Ints) -> str:
    return place(mesh.vertices[ends].mean(axis=0) - mesh.shift)
