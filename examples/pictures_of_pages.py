"""Pictures of the pages on drawing and of the first tutorial.

    python examples/pictures_of_pages.py ring ring.png

`examples/gallery.py` draws them with all others.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

import cpmkit as ck

VIEW = {"view": (-1, 0.4, -0.8), "width": 700}


def ring(file: str) -> None:
    """Draw the scene of the first tutorial."""
    north = ck.source("analytic.circle", center=[0, 0, 0.6], normal=[0, 0, 1], radius=0.8)
    south = ck.source("analytic.circle", center=[0, 0, -0.8], normal=[0, 0, 1], radius=0.6)
    boundaries = [
        ck.Boundary("ring", north, left=ck.Dirichlet([0.95, 0.75, 0.20]), right=ck.Dirichlet([0.10, 0.35, 0.75])),
        ck.Boundary("south", south, both=ck.Dirichlet([0.90, 0.25, 0.20])),
    ]
    scene = ck.Scene(ck.source("analytic.sphere"), ck.Laplace(), boundaries)
    ck.solve(scene, spacing=0.1).picture(file, width=440, view=(0.3, -1.0, 0.1))


def _spot() -> ck.Solution:
    spot = ck.source("mesh.triangles", file="spot.obj")
    return ck.solve(ck.Scene(spot, ck.ScreenedPoisson(lambda x: np.sin(3 * x[:, 1]))), spacing=0.06)


def picture_spot(file: str) -> None:
    """Draw a solution as it comes."""
    _spot().picture(file, **VIEW)


def picture_warm(file: str) -> None:
    """Draw it with other colours, isolines and words."""
    words = {"title": "Warm Spot", "label": "temperature", "unit": "K"}
    _spot().picture(file, cmap="inferno", clim=(-0.4, 0.4), isolines=8, **words, **VIEW)


def picture_arrows(file: str) -> None:
    """Draw channels as arrows over the colours of their lengths."""
    from cpmkit.applications import vector_field

    spot = ck.source("mesh.triangles", file="spot.obj")
    field = vector_field(spot, [([[0, 0.9, -0.6]], [1.0, 0.2, 0])], spacing=0.08)
    field.solution.picture(file, vectors=True, **VIEW)


def picture_modes(file: str) -> None:
    """Draw the first modes of a torus."""
    ck.solve(ck.Scene(ck.source("analytic.torus"), ck.Eigen(count=6)), spacing=0.12).picture(file, width=900)


def heat_on_spot(file: str) -> None:
    """Draw heat that spreads as a film."""
    spot = ck.source("mesh.triangles", file="spot.obj", closest="smooth")
    heat = ck.Heat(lambda x: np.exp(-40 * ((x - [0, 0.9, -0.6]) ** 2).sum(axis=1)), until=0.3, step=0.005, frames=30)
    solution = ck.solve(ck.Scene(spot, heat), spacing=0.06)
    solution.animate(file, fps=12, view=(-1, 0.4, -0.8), width=260, clim=(0, 0.1))


def twins_fish(file: str) -> None:
    """Draw the feet of twins on thin fins."""
    fish = ck.source("mesh.triangles", file="fish.obj")
    size = float(np.ptp(fish.bounds, axis=0).max())
    scene = ck.Scene(fish, ck.ScreenedPoisson(lambda x: np.cos(6 * x[:, 0] / size)))
    solution = ck.solve(scene, spacing=0.0156 * size, form="collocation")
    solution.picture(file, twins=True, light="shaded", width=900, view=(1.0, 0.35, -0.5), up="y")


def difference(mesh: str, file: str) -> None:
    """Draw where the Galerkin form at the finest spacing of `studies/backends.py` differs from finite elements."""
    sys.path.insert(0, str(Path(__file__).parent / "studies"))
    import backends

    spacings, view, up = backends.MESHES[mesh]
    vertices, faces = ck.read_mesh(mesh)
    problem, scene = next(iter(backends.scenes(vertices, faces).items()))
    fem = ck.solve(scene, backend="fem")
    found = backends.compare(mesh, problem, scene, vertices, spacings[-1], fem, backends.FORMS[-1])[1]
    replace(fem, values=100 * found[:, None]).picture(file, width=700, view=view, up=up)


PICTURES = {
    "ring": ring,
    "picture-spot": picture_spot,
    "picture-warm": picture_warm,
    "picture-arrows": picture_arrows,
    "picture-modes": picture_modes,
    "heat-on-spot": heat_on_spot,
    "twins-fish": twins_fish,
    "difference-spot": lambda file: difference("spot.obj", file),
}


def main() -> None:
    """Draw one of the pictures."""
    if len(sys.argv) != 3 or sys.argv[1] not in PICTURES:
        sys.exit(f"usage: python examples/pictures_of_pages.py {{{','.join(PICTURES)}}} PICTURE")
    PICTURES[sys.argv[1]](sys.argv[2])


if __name__ == "__main__":
    main()
