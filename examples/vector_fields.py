"""Vector fields from a few directions, on a surface of revolution, a Moebius strip and a point cloud.

Directions are given at points and along curves, as unit tangents. Each component is harmonic in between; the field
is its part in the tangent plane. That is one Laplace problem with three channels, and not what King et al. (2024),
section 7.3, come to by short steps of heat flow and projections: between two circles of a sphere its directions are 1.2
degrees off at every spacing. ``cpmkit.applications.vector_field`` solves the right problem, with either transport.

    python examples/vector_fields.py revolution vectors-revolution.png
    python examples/vector_fields.py moebius vectors-moebius.png
    python examples/vector_fields.py cloud vectors-cloud.png       (needs spot.obj: docs/how-to/read-a-mesh.md)
"""

from __future__ import annotations

import sys
from dataclasses import dataclass

import numpy as np

import cpmkit as ck


@dataclass(frozen=True)
class Design:
    """A scene whose three channels are a vector field, the spacing to solve it at, and where to look from."""

    scene: ck.Scene
    spacing: float
    view: tuple[float, float, float]
    up: tuple[float, float, float] = (0.0, 0.0, 1.0)


def along(curve, sign=1.0):
    """Return the condition that the field runs along a curve, or against it."""

    def tangent(x):
        return sign * curve.tangents(curve.closest_point(x))

    return ck.Dirichlet([lambda x, k=k: tangent(x)[:, k] for k in range(3)])


def ring(name, surface, at, radius, sign=1.0):
    """Return a small circle on the surface around a point, along which the field turns."""
    foot = surface.closest_point([at])
    normal = normals_at(surface, foot.points)[0]
    circle = ck.source("analytic.circle", center=foot.points[0], normal=normal, radius=radius)
    return ck.Boundary(name, circle, both=along(circle, sign))


def pin(name, surface, at, direction):
    """Return a small circle around a point, on which the field has one direction."""
    foot = surface.closest_point([at]).points
    normal = normals_at(surface, foot)[0]
    tangent = direction - (normal @ direction) * normal
    circle = ck.source("analytic.circle", center=foot[0], normal=normal, radius=0.05 * size(surface))
    return ck.Boundary(name, circle, both=ck.Dirichlet(list(tangent / np.linalg.norm(tangent))))


def size(surface):
    """Return the largest side of the bounds."""
    return float(np.max(surface.bounds[1] - surface.bounds[0]))


def normals_at(surface, points):
    """Return unit normals (n, 3), of any sign: where closest points do not move if the query does."""
    step = 1e-3 * size(surface)
    shifts = step * np.concatenate([np.eye(3), -np.eye(3)])
    feet = surface.closest_point((points[:, None] + shifts).reshape(-1, 3)).points.reshape(-1, 6, 3)
    jacobian = (feet[:, :3] - feet[:, 3:]) / (2 * step)
    return np.linalg.eigh(jacobian + jacobian.transpose(0, 2, 1))[1][:, :, 0]


def revolution() -> Design:
    """Revolve the paper's closed planar curve, c = 1/2, about the z axis; a curve on it parts opposite directions."""
    v = "((cos(t)*(3.5 + sin(3*t) + sin(4*t)) + 3.5)/7)"
    profile = [f"{v}*cos(t) + 0.5", f"{v}*sin(t) + 0.5"]
    surface = ck.source("parametric.revolution", profile=profile, range=[0, 2 * np.pi], periodic=True)
    wave = ck.source("cut.function", surface=surface, phi="z - 0.8 - 0.1*sin(3*arctan2(y, x))")
    boundaries = [
        ck.Boundary("wave", wave, left=along(wave), right=along(wave, -1.0)),
        pin("east", surface, [1.2, 0.2, 0.05], np.array([0, 0, 1.0])),
        pin("west", surface, [-1.2, 0.2, 0.05], np.array([0, 0, -1.0])),
    ]
    return Design(ck.Scene(surface, ck.Laplace(), boundaries), 0.04, (0.3, -1.0, 0.9))


def moebius() -> Design:
    """A vortex and two directions on a Moebius strip; nothing flows through its rim."""
    surface = ck.source("parametric.moebius")
    boundaries = [
        ring("vortex", surface, [0.0, -1.0, 0.0], 0.15),
        pin("first", surface, [1.0, 0.0, 0.0], np.array([0, 1.0, 0])),
        pin("second", surface, [-1.0, 0.2, 0.1], np.array([0, 0, 1.0])),
    ]
    return Design(ck.Scene(surface, ck.Laplace(), boundaries), 0.025, (0.5, -1.0, 0.9))


def cloud() -> Design:
    """Spot the cow, known by points alone: the vertices of a mesh without its triangles."""
    vertices, _ = ck.read_mesh("spot.obj")
    surface = ck.source("pointcloud.points", points=vertices)
    boundaries = [
        pin("nose", surface, [0.0, 0.3, -0.75], np.array([0.0, 1.0, 0.0])),
        ring("flank", surface, [-0.5, 0.0, 0.3], 0.12),
        pin("back", surface, [0.0, 0.4, 0.4], np.array([0.0, 0.0, 1.0])),
        pin("leg", surface, [-0.35, -0.6, -0.1], np.array([0.0, -1.0, 0.0])),
    ]
    return Design(ck.Scene(surface, ck.Laplace(), boundaries), 0.03, (-1.0, 0.35, -0.6), (0.0, 1.0, 0.0))


DESIGNS = {"revolution": revolution, "moebius": moebius, "cloud": cloud}


def field(solution, points):
    """Return the unit directions (n, 3) of the field at points of the surface."""
    vectors = solution.evaluate(points)
    normals = normals_at(solution.scene.surface, points)
    vectors = vectors - np.sum(vectors * normals, axis=1, keepdims=True) * normals
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12)


def spread(points, apart):
    """Return the numbers of points of which no two are nearer than ``apart``."""
    from scipy.spatial import cKDTree

    near = cKDTree(points).query_ball_point(points, apart)
    free, chosen = np.ones(len(points), dtype=bool), []
    for number in np.random.default_rng(0).permutation(len(points)):
        if free[number]:
            chosen.append(number)
            free[near[number]] = False
    return np.array(chosen)


def draw(design: Design, solution, path: str) -> None:
    """Draw the surface in grey, the given curves in red, and arrows."""
    import pyvista

    surface, ivory = design.scene.surface, (0.93, 0.92, 0.9)
    vertices, cells = surface.mesh(0.5 * design.spacing)
    plotter = pyvista.Plotter(off_screen=True, window_size=(900, 760))
    if cells.shape[1] == 3:
        mesh = pyvista.PolyData.from_regular_faces(vertices, cells)
        plotter.add_mesh(mesh, color=ivory, smooth_shading=True)
    else:
        ball = pyvista.Sphere(radius=0.55 * design.spacing, theta_resolution=12, phi_resolution=12)
        balls = pyvista.PolyData(vertices).glyph(orient=False, scale=False, geom=ball)
        plotter.add_mesh(balls, color=ivory, smooth_shading=True)
    lifted = vertices[spread(vertices, 0.035 * size(surface))]
    normals = normals_at(surface, lifted)
    lift = 0.012 * size(surface) if cells.shape[1] == 3 else design.spacing
    facing = np.sign(normals @ np.asarray(design.view))[:, None] * normals
    arrows = pyvista.PolyData(lifted + lift * facing)
    arrows["field"] = field(solution, lifted)
    length = 0.035 * size(surface)
    glyphs = arrows.glyph(orient="field", scale=False, factor=length, geom=pyvista.Arrow(shaft_radius=0.06))
    plotter.add_mesh(glyphs, color=(0.10, 0.25, 0.55))
    for boundary in design.scene.boundaries:
        points, segments = boundary.source.mesh(0.3 * design.spacing)
        on = surface.closest_point(points).points
        facing = np.sign(normals_at(surface, on) @ np.asarray(design.view))[:, None] * normals_at(surface, on)
        on = on + (0.0 if cells.shape[1] == 3 else 0.5 * design.spacing) * facing
        line = pyvista.PolyData(on, lines=np.insert(segments, 0, 2, axis=1))
        plotter.add_mesh(line.tube(radius=0.006 * size(surface)), color=(0.8, 0.15, 0.1))
    plotter.background_color = "white"
    plotter.view_vector(design.view, viewup=design.up)
    plotter.camera.zoom(1.5)
    plotter.screenshot(path)


def main() -> None:
    """Solve and draw one of the designs."""
    if len(sys.argv) != 3 or sys.argv[1] not in DESIGNS:
        sys.exit(f"usage: python examples/vector_fields.py {{{','.join(DESIGNS)}}} PICTURE.png")
    design = DESIGNS[sys.argv[1]]()
    solution = ck.solve(design.scene, design.spacing)
    for sentence in solution.warnings:
        print("warning:", sentence)
    draw(design, solution, sys.argv[2])


if __name__ == "__main__":
    main()
