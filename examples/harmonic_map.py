"""Map a texture from a twisted Spot to Spot, with a noisy map and with the harmonic map to which it relaxes.

The two meshes share their triangles: the vertices of one mesh are the values of the map at the vertices of the other.
Needs spot.obj, see docs/how-to/read-a-mesh.md.

    python examples/harmonic_map.py harmonic-before.png harmonic-after.png
"""

from __future__ import annotations

import sys

import numpy as np

import cpmkit as ck
from cpmkit.applications import harmonic_map

#: Turn per length about the long axis, strength of the noise, stripes per length.
TWIST, NOISE, STRIPES = 0.9, 0.04, 8.0


def twisted(points):
    """Return points turned about the z axis, the more the farther along it they lie."""
    angle = TWIST * points[:, 2]
    x, y = points[:, 0], points[:, 1]
    turned = np.cos(angle) * x - np.sin(angle) * y, np.sin(angle) * x + np.cos(angle) * y
    return np.stack([*turned, points[:, 2]], axis=1)


def stripes(points):
    """Return colours (n, 3): rings along the body, with a hue that turns round it."""
    light = 0.65 + 0.3 * np.sign(np.sin(np.pi * STRIPES * points[:, 2]))[:, None]
    turn = np.arctan2(points[:, 1], points[:, 0])[:, None] + 2 * np.pi / 3 * np.arange(3)
    return light * (0.65 + 0.35 * np.cos(turn))


def main():
    """Draw the texture under the noisy map, and under the one that came of it."""
    if len(sys.argv) != 3:
        sys.exit("usage: python examples/harmonic_map.py BEFORE.png AFTER.png")
    vertices, faces = ck.read_mesh("spot.obj")
    source = ck.source("mesh.triangles", vertices=vertices, faces=faces)
    target = ck.source("mesh.triangles", vertices=twisted(vertices), faces=faces)
    noise = NOISE * np.random.default_rng(0).normal(size=vertices.shape)
    noisy = ck.VertexData(source, twisted(vertices) + noise)
    found = harmonic_map(source, target, initial=noisy, spacing=0.08)
    print("energies:", found.energy.round(3))
    camera = {"width": 700, "view": (-1, 0.3, -0.7), "up": (0, 1, 0)}
    found.picture(sys.argv[2], texture=stripes, **camera)
    mesh = found.solution.display_mesh()
    before = stripes(target.closest_point(noisy(mesh.points)).points)
    found.with_colours(before).picture(sys.argv[1], **camera)


if __name__ == "__main__":
    main()
