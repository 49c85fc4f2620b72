"""Vector fields from a few directions, on a surface of revolution, a Moebius strip and a point cloud.

Directions are given at points and along curves. Each field is what they go on to by parallel transport; with
``transport="paper"`` it is the rest of the flow of King et al. (2024), section 6.3.

    python examples/vector_fields.py revolution vectors-revolution.png
    python examples/vector_fields.py moebius vectors-moebius.png
    python examples/vector_fields.py cloud vectors-cloud.png       (needs spot.obj: docs/how-to/read-a-mesh.md)
"""

from __future__ import annotations

import sys

import numpy as np

import cpmkit as ck
from cpmkit.applications import vector_field


def ring(surface, at, radius):
    """Return a circle about a point of the surface."""
    foot = surface.closest_point([at]).points
    return ck.source("analytic.circle", center=foot[0], normal=ck.normals_at(surface, foot)[0], radius=radius)


def revolution():
    """Revolve the paper's closed planar curve about the z axis; the field turns round across a curve on it."""
    v = "((cos(t)*(3.5 + sin(3*t) + sin(4*t)) + 3.5)/7)"
    profile = [f"{v}*cos(t) + 0.5", f"{v}*sin(t) + 0.5"]
    surface = ck.source("parametric.revolution", profile=profile, range=[0, 2 * np.pi], periodic=True)
    wave = ck.source("cut.function", surface=surface, phi="z - 0.8 - 0.1*sin(3*arctan2(y, x))")
    east, west = (ring(surface, [x, -0.9, 0.3], 0.08) for x in (0.9, -0.9))
    directions = [(wave, {"left": "tangent", "right": "backwards"}), (east, [0, 0, 1]), (west, [0, 0, -1])]
    return vector_field(surface, directions, spacing=0.08), {"view": (0.1, -1.0, 0.75)}


def moebius():
    """A vortex, four directions at points, and a barrier that nothing passes on a Moebius strip."""
    surface = ck.source("parametric.moebius")
    barrier = ck.source("cut.function", surface=surface, phi="y - 0.35", where="x > 0")
    scene = ck.Scene(surface, ck.Laplace(), [ck.Boundary("barrier", barrier, both=ck.Neumann())])
    points = [[1.0, -0.2, 0.0], [-1.0, 0.2, 0.1], [0.0, 1.0, 0.0], [0.7, 0.7, 0.1]]
    which = [[0, 1.0, 0], [0, 0, 1.0], [1.0, 0, 0], [0, 0, 1.0]]
    directions = [(ring(surface, [0.0, -1.0, 0.0], 0.15), "tangent")]
    directions += [(ring(surface, at, 0.04), one) for at, one in zip(points, which, strict=True)]
    return vector_field(scene, directions, spacing=0.03), {"view": (0.5, -1.0, 0.9)}


def cloud():
    """Spot the cow, known by points alone: the vertices of a mesh without its triangles."""
    surface = ck.source("pointcloud.points", points=ck.read_mesh("spot.obj")[0])
    directions = [
        (ring(surface, [0.0, 0.3, -0.75], 0.06), [0, 1.0, 0]),
        (ring(surface, [-0.5, 0.0, 0.3], 0.12), "tangent"),
        (ring(surface, [0.0, 0.4, 0.4], 0.06), [0, 0, 1.0]),
        (ring(surface, [-0.35, -0.6, -0.1], 0.04), [0, -1.0, 0]),
    ]
    return vector_field(surface, directions, spacing=0.05), {"view": (-1.0, 0.35, -0.6), "up": (0, 1.0, 0)}


DESIGNS = {"revolution": revolution, "moebius": moebius, "cloud": cloud}


def main():
    """Solve and draw one of the designs."""
    if len(sys.argv) != 3 or sys.argv[1] not in DESIGNS:
        sys.exit(f"usage: python examples/vector_fields.py {{{','.join(DESIGNS)}}} PICTURE.png")
    field, camera = DESIGNS[sys.argv[1]]()
    field.picture(sys.argv[2], width=900, **camera)
    for one in field.singularities if sys.argv[1] != "cloud" else []:
        print(f"index {one.index} at {one.place.round(3)}")


if __name__ == "__main__":
    main()
