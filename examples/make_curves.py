"""Draw the diffusion curves of scenes 02 and 03: geodesics through chosen vertices of a triangle mesh.

`python examples/make_curves.py` writes them into `examples/curves/`. It finds the meshes as scenes do (beside the
scenes, in the folder that CPMKIT_DATA names, in the cache), and needs cpmkit-mesh and the extra `geodesics`. The curves
are stored with the scenes, so this program is needed only to change them.

Geodesics are traced by edge flips (Sharp and Crane, "You can find geodesic paths in triangle meshes by just flipping
edges", ACM Trans. Graph. 39 (6), 2020). Every point lies on an edge or a vertex of the mesh; nothing is simplified.
The left of a curve is n x t, with n the outward normal and t the direction of travel.

Where two legs meet, the curve has a corner. On the outer side of a corner the solution of the Laplace equation is
singular, so a grid gives the colour there only roughly: curves that are not straight take many vertices that lie close
to a smooth guide. They also keep away from folds, gaps and other curves that a band of a few spacings would bridge.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Point = tuple[float, float, float]
CANDIDATES = 12  # vertices that compete for each corner of a ring


@dataclass(frozen=True)
class Through:
    """Geodesics from vertex to vertex, each the vertex nearest to one of `points`; `closed` returns to the first.

    With `corners`, the points are those of a smooth closed guide, and that many vertices close to it are chosen.
    """

    points: tuple[Point, ...]
    closed: bool = False
    corners: int = 0

    def vertices(self, mesh: Floats) -> list[int]:
        """The chosen ones of the vertices (n, 3) `mesh`, in the order of travel."""
        from scipy.interpolate import CubicSpline
        from scipy.spatial import KDTree

        if not self.corners:
            return [int(vertex) for vertex in KDTree(mesh).query(self.points)[1]]
        points = np.array([*self.points, self.points[0]])
        length = np.r_[0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))]
        shares = np.arange(0, 1, 1e-4)
        miss, nearest = KDTree(CubicSpline(length, points, bc_type="periodic")(shares * length[-1])).query(mesh)
        return chosen(mesh, shares[nearest], miss, self.corners)


@dataclass(frozen=True)
class Ring:
    """A closed curve, counter-clockwise about `normal`, held at a vertex in each of `corners` directions.

    Those vertices are close to the plane through `centre`, or, with a `radius`, to the sphere about `centre`.
    `reach` leaves out what the plane cuts elsewhere. A `tight` ring is pulled straight to a closed geodesic; only a
    waist has one, from anywhere else a ring would slip off.
    """

    centre: Point
    normal: Point
    corners: int = 24
    radius: float | None = None
    reach: float = np.inf
    tight: bool = False
    closed: bool = True

    def vertices(self, mesh: Floats) -> list[int]:
        """The chosen ones of the vertices (n, 3) `mesh`, in the order of travel."""
        normal = np.asarray(self.normal) / np.linalg.norm(self.normal)
        first = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
        offset = mesh - np.asarray(self.centre)
        distance = np.linalg.norm(offset, axis=1)
        miss = np.abs(offset @ normal if self.radius is None else distance - self.radius)
        angle = np.arctan2(offset @ np.cross(normal, first), offset @ first)
        return chosen(mesh, angle / (2 * np.pi) % 1, np.where(distance > self.reach, np.inf, miss), self.corners)


def chosen(mesh: Floats, share: Floats, miss: Floats, corners: int) -> list[int]:
    """One of the vertices (n, 3) `mesh` in each of `corners` equal parts of the way round.

    `share` says how far round each vertex is, from 0 to 1, and `miss` how far from the guide. Of each part a few
    vertices compete that miss by less than half a leg; only its middle half counts, so that no two chosen vertices are
    close together.
    """
    place, part = np.modf(share * corners)
    competes = (part == np.arange(corners)[:, None]) & (np.abs(place - 0.5) <= 1 / 4)
    miss = np.where(competes, miss, np.inf)
    nearest = np.argsort(miss, axis=1)[:, :CANDIDATES]
    best = mesh[nearest[:, 0]]
    leg = np.median(np.linalg.norm(best - np.roll(best, 1, axis=0), axis=1))
    nearest = np.where(np.take_along_axis(miss, nearest, axis=1) < leg / 2, nearest, nearest[:, :1])
    return [int(vertex) for vertex in nearest[np.arange(corners), straightest(mesh[nearest])]]


def straightest(points: Floats) -> NDArray[np.int64]:
    """Which of the k candidates (n, k, 3) to take at each corner of a closed polygon to turn least, in squares.

    Shortest ways are continued corner by corner, for each first leg (a, b) and each last leg so far.
    """
    n, k = points.shape[:2]
    leg = np.roll(points, -1, axis=0)[:, None] - points[:, :, None]
    leg /= np.linalg.norm(leg, axis=-1, keepdims=True)
    turn = np.arccos(np.clip(np.einsum("iabx,ibcx->iabc", leg, np.roll(leg, -1, axis=0)), -1, 1)) ** 2
    total = np.where(np.eye(k * k, dtype=bool), 0, np.inf).reshape(k * k, k, k)
    came_from = []
    for corner in range(n):
        reached = total[..., None] + turn[corner]
        came_from.append(reached.argmin(axis=1))
        total = reached.min(axis=1)
    first = int(total.reshape(k * k, k * k).diagonal().argmin())
    this, after = divmod(first, k)
    way = []
    for back in reversed(came_from):
        this, after = int(back[first, this, after]), this
        way.append(this)
    return np.array(way[::-1])


def mirrored(*half: Point) -> tuple[Point, ...]:
    """The closed way round: the points of the half x >= 0, then their mirror images in x = 0, back to front."""
    return half + tuple((-x, y, z) for x, y, z in reversed(half) if x > 0)


# y is up and the face looks along +z. Rings are counter-clockwise from above: their left is above them.
UP = (0, 0.932, -0.363)  # the painted ribbon about the crown is square to this
NEFERTITI = {
    "crest": Ring((0, 193, -40), UP, corners=28),  # below the rim of the crown
    "ribbon-upper": Ring((0, 131, 0), UP, corners=18),  # above the loops of the uraeus, where its body is flattest,
    "ribbon-lower": Ring((0, 54, 0), UP, corners=28),  # and well below the end of its tail
    "diadem": Ring((0, 29, 0), UP),  # middle of the forehead's band, then high above the ears
    "brow-right": Through(((-57, 43, 118), (-42, 49, 132), (-27, 49, 142), (-11, 44, 150))),  # the bust's own right
    "brow-left": Through(((15, 44, 150), (31, 49, 142), (46, 49, 132), (61, 43, 118))),
    "cheek-right": Through(((-63, 12, 100), (-50, -45, 118))),  # from the temple to the corner of the jaw
    "cheek-left": Through(((51, -45, 118), (64, 12, 100))),
    "lips": Through(  # round the mouth, counter-clockwise seen from the front: left is inside
        (
            (-25, -37, 151), (-24, -45, 150), (-12, -51, 161), (5, -52, 165), (19, -50, 161), (29, -46, 150),
            (32, -39, 150), (29, -33, 154), (18, -29, 164), (3, -28, 170), (-11, -28, 165), (-22, -32, 156),
        ),
        closed=True,
    ),
    "neck": Ring((0, -95, 55), (0, 0.85, 0.53), corners=8, tight=True),
    "collar-upper": Through(  # round the foot of the neck; from the notch between the collar bones to the nape
        mirrored(
            (0, -174, 62), (26, -163, 58), (43, -139, 45), (47, -118, 18), (42, -122, 2), (24, -132, -22),
            (0, -136, -28),
        ),
        closed=True,
        corners=18,
    ),
    "collar-lower": Through(  # down the chest, over the shoulders, down the back
        mirrored(
            (0, -214, 74), (25, -210, 72), (50, -196, 64), (68, -174, 50), (76, -152, 26), (77, -142, 2),
            (76, -150, -24), (66, -176, -46), (46, -196, -58), (24, -208, -60), (0, -212, -57),
        ),
        closed=True,
        corners=32,
    ),
    # Rings on the two faces of her right ear, opposite to each other: the shell between them is about 10 thick.
    "ear-front": Through(
        ((-80, 8, 54), (-77, 4, 57), (-73, 7, 59), (-72, 13, 59), (-75, 18, 58), (-79, 15, 54)), closed=True
    ),
    "ear-back": Through(
        ((-74, 17, 46), (-71, 11, 45), (-73, 5, 46), (-78, 3, 47), (-80, 10, 47), (-79, 18, 47)), closed=True
    ),
}  # fmt: skip

# y is up and the face looks along -z. Rings about the body run so that their left is towards the head.
SPOT = {
    "muzzle": Ring((0, 0.43, -0.51), (0, -0.22, -0.975), corners=20),
    "neck": Ring((0, 0.2, -0.05), (0, 0.6, -0.8), corners=8, tight=True),
    "belly": Ring((0, -0.1, 0.4), (0, 0, -1), corners=22),
    "hip": Ring((-0.36, -0.13, 0.79), (-1, 0, 0), corners=18, radius=0.16),  # spots: their left is inside
    "shoulder": Ring((0.36, -0.1, 0.03), (1, 0, 0), corners=18, radius=0.16),
    "rump": Ring((0, 0.23, 0.74), (0, 1, 0), corners=16, radius=0.16),
}

MODELS: dict[str, tuple[str, dict[str, Ring | Through]]] = {
    "nefertiti": ("nefertiti-lowres.obj", NEFERTITI),
    "spot": ("spot.obj", SPOT),
}


def trace(solver: Any, corners: list[int], *, closed: bool, tight: bool) -> Floats:
    """The polyline (n, 3) through the vertices `corners`; a closed one ends exactly where it began."""
    if tight:
        points = np.asarray(solver.find_geodesic_loop(corners))
    else:
        ends = corners[1:] + corners[:1] if closed else corners[1:]
        legs = [np.asarray(solver.find_geodesic_path(a, b)) for a, b in zip(corners, ends, strict=False)]
        points = np.concatenate([legs[0][:1], *(leg[1:] for leg in legs)])
    if closed:
        points[-1] = points[0]
    return np.ascontiguousarray(points)


def main(folder: Path = Path(__file__).parent / "curves", models: tuple[str, ...] = tuple(MODELS)) -> dict[str, float]:
    """Write every curve as `folder`/MODEL-CURVE.npy and return their lengths in the mesh's unit."""
    try:
        import potpourri3d
    except ImportError as error:
        raise SystemExit("potpourri3d is missing, which traces geodesics: pip install 'cpmkit[geodesics]'.") from error
    from cpmkit_mesh import read_mesh

    from cpmkit.files.whole_files import find_file

    lengths = {}
    for model in models:
        file, curves = MODELS[model]
        vertices, faces = read_mesh(find_file(file, folder.parent))
        solver = potpourri3d.EdgeFlipGeodesicSolver(vertices, faces)
        for name, curve in curves.items():
            tight = isinstance(curve, Ring) and curve.tight
            points = trace(solver, curve.vertices(vertices), closed=curve.closed, tight=tight)
            np.save(folder / f"{model}-{name}.npy", points)
            lengths[f"{model}-{name}"] = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
    return lengths


if __name__ == "__main__":
    for curve_name, length in main().items():
        print(f"{curve_name:24s} length {length:.4g}")
