"""Draw the diffusion curves of scenes 02 and 03: geodesics through chosen vertices of a triangle mesh.

`python examples/make_curves.py` writes them into `examples/curves/`. It finds the meshes in the working directory or in
the folder that CPMKIT_DATA names, and needs `trimesh` and the extra `geodesics`. The curves are kept with the scenes,
so that nobody has to run this first.

Geodesics are traced by edge flips (Sharp and Crane, "You can find geodesic paths in triangle meshes by just flipping
edges", ACM Trans. Graph. 39 (6), 2020). Every point lies on an edge or a vertex of the mesh; nothing is simplified.
The left of a curve is n x t, with n the outward normal and t the direction of travel.
"""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Point = tuple[float, float, float]


@dataclass(frozen=True)
class Through:
    """Geodesics from vertex to vertex, each the vertex nearest to one of `points`; `closed` returns to the first."""

    points: tuple[Point, ...]
    closed: bool = False

    def vertices(self, mesh: Floats) -> list[int]:
        """The chosen ones of the vertices (n, 3) `mesh`, in the order of travel."""
        return [int(np.square(mesh - point).sum(axis=1).argmin()) for point in self.points]


@dataclass(frozen=True)
class Ring:
    """A closed curve, counter-clockwise about `normal`, held at one vertex in each of `corners` directions.

    That vertex is the nearest one to the plane through `centre`, or, with a `radius`, to the sphere about `centre`.
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
        turn, sector = np.modf(angle / (2 * np.pi) % 1 * self.corners)
        # Only the middle half of each sector competes, so that no two corners are close together.
        miss[(np.abs(turn - 0.5) > 1 / 4) | (distance > self.reach)] = np.inf
        return [int(np.where(sector == corner, miss, np.inf).argmin()) for corner in range(self.corners)]


def mirrored(*half: Point) -> tuple[Point, ...]:
    """The closed way round: the points of the half x >= 0, then their mirror images in x = 0, back to front."""
    return half + tuple((-x, y, z) for x, y, z in reversed(half) if x > 0)


# y is up and the face looks along +z. Rings are counter-clockwise from above: their left is above them.
UP = (0, 0.932, -0.363)  # the painted ribbon about the crown is square to this
NEFERTITI = {
    "crest": Ring((0, 172, -40), UP),  # below the rim of the crown
    "ribbon-upper": Ring((0, 139, -5), UP),  # the painted ribbon's edges, which pass
    "ribbon-lower": Ring((0, 98, 0), UP),  # above and below the loops of the uraeus
    "diadem": Ring((0, 34, 0), UP),  # middle of the forehead's band, then high above the ears
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
            (0, -180, 64), (22, -174, 62), (38, -155, 55), (45, -132, 40), (47, -118, 18), (42, -122, 2),
            (24, -132, -22), (0, -136, -28),
        ),
        closed=True,
    ),
    "collar-lower": Through(  # down the chest, over the shoulders, down the back
        mirrored(
            (0, -214, 74), (25, -210, 72), (50, -196, 64), (68, -174, 50), (76, -152, 26), (77, -142, 2),
            (76, -150, -24), (66, -176, -46), (46, -196, -58), (24, -208, -60), (0, -212, -57),
        ),
        closed=True,
    ),
}  # fmt: skip

# y is up and the face looks along -z. Rings about the body run so that their left is towards the head.
SPOT = {
    "muzzle": Ring((0, 0.43, -0.51), (0, -0.22, -0.975)),
    "neck": Ring((0, 0.2, -0.05), (0, 0.6, -0.8), corners=8, tight=True),
    "belly": Ring((0, -0.1, 0.4), (0, 0, -1)),
    "hip": Ring((-0.36, -0.1, 0.78), (-1, 0, 0), corners=12, radius=0.16),  # spots: their left is inside
    "shoulder": Ring((0.36, -0.1, 0.03), (1, 0, 0), corners=12, radius=0.16),
    "rump": Ring((0, 0.23, 0.74), (0, 1, 0), corners=12, radius=0.14),
    "sock-front": Ring((-0.22, -0.55, 0.07), (0, 1, 0), corners=8, reach=0.25),  # on the cow's own left
    "sock-hind": Ring((0.22, -0.55, 0.78), (0, 1, 0), corners=8, reach=0.25),
}

MODELS: dict[str, tuple[str, dict[str, Ring | Through]]] = {
    "nefertiti": ("nefertiti-lowres.obj", NEFERTITI),
    "spot": ("spot.obj", SPOT),
}


def read_mesh(file: str) -> tuple[Floats, NDArray[np.int64]]:
    """Vertices and faces; corners that the file stores once a texture seam are merged where they coincide exactly."""
    import trimesh

    folders = [Path(), Path(os.environ.get("CPMKIT_DATA", "."))]
    path = next((folder / file for folder in folders if (folder / file).exists()), None)
    if path is None:
        raise FileNotFoundError(f"{file} is not in {folders}: put it there, or name its folder in CPMKIT_DATA.")
    mesh = trimesh.load(path, process=False, maintain_order=True)
    vertices, merged = np.unique(np.asarray(mesh.vertices, dtype=np.float64), axis=0, return_inverse=True)
    return vertices, merged.reshape(-1)[np.asarray(mesh.faces, dtype=np.int64)]


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
    import potpourri3d

    lengths = {}
    for model in models:
        file, curves = MODELS[model]
        vertices, faces = read_mesh(file)
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
