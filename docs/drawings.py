"""Draw the pictures of the explanation pages from what cpmkit itself computes.

``python docs/drawings.py FOLDER`` writes them; the documentation's build calls :func:`draw_all`.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

import cpmkit as ck
from cpmkit.forms.collocation.side_view import SideView

LEFT, RIGHT, NOWHERE = np.array([0.85, 0.45, 0.20]), np.array([0.22, 0.47, 0.72]), np.array([0.80, 0.80, 0.80])
INK, GREY = "#1b1b1b", "#8a8a8a"
#: Points along a side of what is coloured by its sides.
PIXELS = 500
#: Where the camera of the spheres stands, and what is up in the picture.
CAMERA, UP = np.array([0.35, -1.0, 0.75]), np.array([0.0, 0.0, 1.0])


def draw_all(folder: Path) -> list[Path]:
    """Write every drawing into ``folder``, which is made if need be, and return the files."""
    folder.mkdir(parents=True, exist_ok=True)
    drawings: dict[str, Callable[[], Figure]] = {
        "left-and-right.png": left_and_right,
        "corner.png": corner,
        "point-on-curve.png": point_on_curve,
        "ghost.png": ghost,
    }
    with mpl.rc_context({"font.size": 11, "mathtext.fontset": "cm"}):
        for name, draw in drawings.items():
            draw().savefig(folder / name, dpi=120, bbox_inches="tight")
    return [folder / name for name in drawings]


def left_and_right() -> Figure:
    """Draw the sides of a closed circle and of an arc on a sphere."""
    circle = ck.source("analytic.circle", center=[0, 0, 0.35], radius=np.sqrt(1 - 0.35**2), normal=[0, 0, 1])
    arc = ck.source("analytic.arc", start=-2.3, end=-0.3, normal=[0, 0, 1], x_axis=[1, 0, 0])
    figure = Figure(figsize=(9, 4.6))
    panels = ((circle, "a closed curve", (-1.9, -0.7), -0.6), (arc, "an open curve", (-1.6, -0.75), -0.82))
    for number, (curve, title, angles, below) in enumerate(panels, 1):
        axes = figure.add_subplot(1, 2, number)
        _sphere(axes, curve, angles)
        axes.text(0.0, 0.45, "left", ha="center", color="white", weight="bold")
        axes.text(0.0, below, "right", ha="center", color="white", weight="bold")
        axes.set_title(title)
    return figure


def _sphere(axes: Any, curve: ck.ClosestPointSource, angles: tuple[float, float]) -> None:
    """Draw a unit sphere, coloured by the side of ``curve``, with the directions at two of its points."""
    sphere = ck.source("analytic.sphere")
    sides = _sides(sphere, curve, 0.25)
    right, above, towards = _camera()
    u, w = np.meshgrid(np.linspace(-1, 1, PIXELS), np.linspace(-1, 1, PIXELS))
    visible = u**2 + w**2 < 1
    depth = np.sqrt(np.where(visible, 1 - u**2 - w**2, 0))
    points = u[..., None] * right + w[..., None] * above + depth[..., None] * towards
    picture = np.ones((*u.shape, 4))
    picture[..., 3] = visible
    shade = 0.35 + 0.65 * depth[visible]
    picture[visible, :3] = 1 - shade[:, None] * (1 - _side_colours(sides.signed_distance("C", points[visible])))
    axes.imshow(picture, origin="lower", extent=(-1, 1, -1, 1), interpolation="bilinear")

    vertices, cells = curve.mesh(0.02)
    facing = (vertices[cells] @ towards).min(axis=1) > 0
    for segment in vertices[cells[facing]]:
        axes.plot(segment @ right, segment @ above, color=INK, lw=2, solid_capstyle="round")

    guesses = np.array([[np.cos(angle), np.sin(angle), 0.3] for angle in angles])
    feet = curve.closest_point(guesses)
    view = _side_view(sides, feet.points)
    tangent, normal = curve.tangents(feet), sphere.normals(sphere.closest_point(feet.points))
    for at, t, n, v in zip(feet.points, tangent, normal, view.conormal, strict=True):
        for vector, name in ((t, "$t$"), (n, "$n$"), (v, "$v$")):
            _arrow(axes, [at @ right, at @ above], [vector @ right, vector @ above], name, 0.4)
    axes.set(xlim=(-1.1, 1.1), ylim=(-1.1, 1.15), aspect="equal")
    axes.axis("off")


def corner() -> Figure:
    """Draw the sides of a curve with a corner, in a flat surface."""
    vertices = np.array([[x, y, 0.0] for x in (-1, 1) for y in (-1, 1)])
    square = ck.source("mesh.triangles", vertices=vertices, faces=[[0, 2, 3], [0, 3, 1]], closest="faceted")
    bend = np.array([[-0.9, -0.5, 0], [0.2, 0.0, 0], [-0.6, 0.8, 0]])
    sides = _sides(square, ck.source("mesh.polyline", points=bend), 0.4)
    figure = Figure(figsize=(4.6, 4.6))
    axes = figure.add_subplot()
    x, y = np.meshgrid(np.linspace(-1, 1, PIXELS), np.linspace(-1, 1, PIXELS))
    signed = sides.signed_distance("C", np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3))
    axes.imshow(_side_colours(signed).reshape(PIXELS, PIXELS, 3), origin="lower", extent=(-1, 1, -1, 1))
    axes.plot(*bend[:, :2].T, color=INK, lw=2.5)
    along = sides.scene.boundaries[0].source
    at = np.array([[-0.45, -0.3, 0.0], [0.2, 0.0, 0.0], [-0.25, 0.45, 0.0]])
    feet = along.closest_point(at)
    view = _side_view(sides, feet.points)
    for foot, t, v in zip(feet.points, along.tangents(feet), view.conormal, strict=True):
        _arrow(axes, foot[:2], t[:2], "", 0.3)
        _arrow(axes, foot[:2], v[:2], "$v$", 0.3)
        beside = foot + 0.3 * t - 0.09 * v
        axes.text(*beside[:2], "$t$", ha="center", va="center", fontsize=14, color=INK)
    axes.text(-0.72, 0.15, "left", ha="center", color="white", weight="bold")
    axes.text(0.62, -0.55, "right", ha="center", color="white", weight="bold")
    axes.axis("off")
    return figure


def point_on_curve() -> Figure:
    """Draw a circle that is cut at one point, coloured by the solution with 1 on the left and 0 on the right."""
    scene = _cut_circle()
    solution = ck.solve(scene, 0.1, form="collocation")
    angles = np.linspace(0, 2 * np.pi, 721) + 0.9
    points = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    middle = 0.5 * (points[1:] + points[:-1])
    values = solution.evaluate(middle)
    figure = Figure(figsize=(4.6, 4.6))
    axes = figure.add_subplot()
    colours = values[:, None] * LEFT + (1 - values[:, None]) * RIGHT
    axes.scatter(*middle.T, c=np.clip(colours, 0, 1), s=45, linewidths=0)
    for angle in (2.6, 4.0, 5.6):
        at = np.array([np.cos(angle), np.sin(angle)])
        _arrow(axes, 0.88 * at - 0.12 * np.array([-at[1], at[0]]), np.array([-at[1], at[0]]), "", 0.24)
    axes.text(-0.62, 0.02, "direction\nof travel", ha="left", va="center", color=INK)
    cut = scene.boundaries[0].source.closest_point(np.zeros((1, 2))).points[0]
    axes.plot(*cut, "o", color=INK, ms=8)
    axes.annotate("$C$", cut, (11, 9), textcoords="offset points", fontsize=14)
    for angle, name, colour in ((0.9 - 0.28, "left", LEFT), (0.9 + 0.28, "right", RIGHT)):
        axes.text(1.22 * np.cos(angle), 1.2 * np.sin(angle), name, color=colour, weight="bold", ha="center")
    axes.set(xlim=(-1.25, 1.5), ylim=(-1.2, 1.3), aspect="equal")
    axes.axis("off")
    return figure


def ghost() -> Figure:
    """Draw the nodes near a cut, which of them have a ghost, and what one ghost reads."""
    cut = ck.discretize(_cut_circle(), 0.1, form="collocation")
    layout = cut.tables.layout
    band, ghosts = layout.band, layout.ghosts[0]
    figure = Figure(figsize=(7.5, 5.4))
    axes = figure.add_subplot()
    angles = np.linspace(0, 2 * np.pi, 400)
    axes.plot(np.cos(angles), np.sin(angles), color=INK, lw=1.5)
    axes.plot(*band.positions[band.inner :].T, ".", color="#c9c9c9", ms=5)
    axes.plot(*band.positions[: band.inner].T, ".", color=GREY, ms=7)
    own = band.positions[ghosts.nodes[: ghosts.unknowns]]
    continues_left = ghosts.continues_left[: ghosts.unknowns]
    for side, colour, name in ((continues_left, LEFT, "left"), (~continues_left, RIGHT, "right")):
        label = f"node with a ghost that carries the {name}"
        axes.plot(*own[side].T, "o", mfc="none", mec=colour, mew=1.8, ms=9, label=label)

    chosen = int(np.argmin(np.linalg.norm(own - [0.9, 0.8], axis=1)))
    x, z = own[chosen], band.feet.points[ghosts.nodes[chosen]]
    seen = _side_view(cut, z[None])
    y, mirror = seen.foot[0], ghosts.formula.points[chosen]
    axes.plot(*np.stack([x, z]).T, "--", color=INK, lw=1)
    for point, name, offset in (
        (x, "$x$, where the ghost stands", (14, -4)),
        (z, "$z = cp_S(x)$", (-96, -14)),
        (y, "$y = cp_C(z)$", (-100, -10)),
        (mirror, "mirror", (-62, -10)),
    ):
        axes.plot(*point, "o", color=INK, ms=6, zorder=5)
        box = {"facecolor": "white", "edgecolor": "none", "pad": 1.5}
        axes.annotate(name, point, offset, textcoords="offset points", fontsize=12, bbox=box)
    axes.set(xlim=(0.0, 1.5), ylim=(0.2, 1.3), aspect="equal")
    axes.legend(loc="upper right", frameon=False, fontsize=10)
    axes.axis("off")
    return figure


def _two_sided(surface: ck.ClosestPointSource, curve: ck.ClosestPointSource) -> ck.Scene:
    boundary = ck.Boundary("C", curve, left=ck.Dirichlet(1.0), right=ck.Dirichlet(0.0))
    return ck.Scene(surface, ck.Laplace(), [boundary])


def _sides(surface: ck.ClosestPointSource, curve: ck.ClosestPointSource, spacing: float) -> Any:
    """Return the scene on a lattice, unsolved: only its sides are drawn, and values would run together at open ends."""
    return ck.discretize(_two_sided(surface, curve), spacing, form="collocation")


def _cut_circle() -> ck.Scene:
    point = ck.source("analytic.point", at=[np.cos(0.9), np.sin(0.9)])
    return _two_sided(ck.source("analytic.circle"), point)


def _side_view(discretized: Any, points: Any) -> SideView:
    """Return how the boundary sees ``points``, in the scene's coordinates."""
    layout = discretized.tables.layout
    on_lattice = layout.boundaries.on_lattice[0]
    return on_lattice.side_view(layout.lattice.to_local(points), np.inf, discretized.spacing)


def _side_colours(signed: Any) -> Any:
    """Return a colour (n, 3) for signed distances: left, right, or no side; paler away from the boundary."""
    base = np.where(signed[:, None] > 0, LEFT, np.where(signed[:, None] < 0, RIGHT, NOWHERE))
    paler = np.clip(np.abs(np.nan_to_num(signed)), 0, 1)[:, None] * 0.45
    return base + paler * (1 - base)


def _camera() -> tuple[Any, Any, Any]:
    towards = CAMERA / np.linalg.norm(CAMERA)
    right = np.cross(UP, towards)
    right /= np.linalg.norm(right)
    return right, np.cross(towards, right), towards


def _arrow(axes: Any, start: Any, direction: Any, name: str, length: float) -> None:
    end = np.asarray(start) + length * np.asarray(direction)
    axes.annotate("", end, start, arrowprops={"arrowstyle": "-|>", "color": INK, "lw": 1.8, "shrinkA": 0, "shrinkB": 0})
    beyond = np.asarray(direction) / max(float(np.linalg.norm(direction)), 0.1)
    axes.text(*(end + 0.07 * beyond), name, ha="center", va="center", fontsize=14, color=INK)


if __name__ == "__main__":
    for written in draw_all(Path(sys.argv[1])):
        print(written)
