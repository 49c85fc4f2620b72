"""Paint Spot from geodesics through picked points, with named colours that change along the curves.

`python examples/diffusion_curves.py` writes `diffusion-curves.png`, or the file that you name. It finds the mesh as
scenes do, and needs cpmkit-mesh and the extra `geodesics`.
"""

import sys
from pathlib import Path

import numpy as np

import cpmkit as ck
from cpmkit.applications import ColouredSurface, diffusion_curves

SPACING = 0.04  # the model is 1.8 long
VIEW = {"view": (-1.0, 0.4, -0.5), "up": (0, 1, 0)}
BACK = ((0, 0.26, 0.45), (0, 0.25, 0.75), (0, 0.1, 0.93))  # along the spine
NECK = ((0.3, 0.2, -0.05), (0, 0.45, 0.15), (-0.3, 0.2, -0.05), (0, -0.1, -0.25))


def ring(centre: tuple[float, float, float], radius: float, count: int) -> np.ndarray:
    """Return points (count, 3) of a circle about the z axis' direction, clockwise as seen from the cow's tail."""
    turn = -2 * np.pi * np.arange(count) / count
    return np.asarray(centre) + radius * np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)


def main(picture: Path = Path("diffusion-curves.png"), spacing: float = SPACING) -> ColouredSurface:
    cow = ck.source("mesh.triangles", file="spot.obj")
    belly = cow.closest_point(ring((0, -0.1, 0.4), 0.4, 20)).points
    neck = cow.closest_point(np.array(NECK)).points
    curves = {
        "belly": (
            ck.source("mesh.path", surface=cow, through=belly, closed=True),
            {"left": ["gold", "tomato", "gold"], "right": ["teal", "midnightblue", "teal"]},
        ),
        "neck": (
            ck.source("mesh.path", surface=cow, through=neck, closed=True, tight=True),
            {"left": "tomato", "right": "#f7c6b0"},
        ),
        "back": (
            ck.source("mesh.path", surface=cow, through=cow.closest_point(np.array(BACK)).points),
            {"left": "plum", "right": "lightcyan"},
        ),
    }
    found = diffusion_curves(cow, curves, spacing=spacing)
    found.picture(picture, width=900, **VIEW)
    return found


if __name__ == "__main__":
    print(main(Path(*sys.argv[1:2] or ["diffusion-curves.png"])).solution)
