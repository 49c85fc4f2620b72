"""A curve on one face of a thin part colours that face alone: ellipsoid, fins of the fish, Nefertiti's ear."""

import numpy as np
import pytest

import cpmkit as ck


@pytest.fixture(scope="module")
def thin_ellipsoid():
    """A smooth mesh of the ellipsoid 1 : 1 : 0.1."""
    points, cells = ck.source("analytic.sphere").mesh(0.1)
    return ck.source("mesh.triangles", vertices=points * [1, 1, 0.1], faces=cells, closest="smooth")


def parted(solution, normal):
    """How far u is from 1 on the one side of a plane and from 0 on the other, at the vertices."""
    vertices, _ = solution.scene.surface.mesh(solution.spacing)
    side = (vertices - [0.1, 0, 0]) @ (np.asarray(normal) / np.linalg.norm(normal))
    clear = np.abs(side) > 0.02
    return np.abs(solution.evaluate(vertices[clear]) - (side[clear] > 0)).max()


@pytest.mark.parametrize("normal", [(1, 0.2, 2), pytest.param((1, 0.2, 1), marks=pytest.mark.slow)])
def test_a_curve_around_a_thin_part_parts_both_sheets(thin_ellipsoid, normal):
    """A slanting plane: on one face the curve runs up to 6 spacings away from where it runs on the other."""
    plane = ck.source("cut.plane", surface=thin_ellipsoid, point=[0.1, 0, 0], normal=list(normal))
    curve = ck.Boundary("curve", plane, left=ck.Dirichlet(1.0), right=ck.Dirichlet(0.0))
    scene = ck.Scene(thin_ellipsoid, ck.Laplace(), [curve])
    assert parted(ck.solve(scene, 0.09, form="collocation", solver="reference"), normal) <= 1e-6
    if normal == (1, 0.2, 2):
        assert parted(ck.solve(scene, 0.09, sheets=False, solver="reference"), normal) > 0.5


def discs(surface, height):
    """Rings on both faces, opposite each other, where spheres meet them that do not reach the other face."""
    colours = {"upper": ([0.9, 0.8, 0.2], [0.8, 0.2, 0.1]), "lower": ([0.1, 0.2, 0.7], [0.3, 0.7, 0.8])}
    boundaries, centres = [], {}
    for (name, (inside, outside)), sign in zip(colours.items(), (1, -1), strict=True):
        centre = np.array([0.1, 0.05, sign * height])
        phi = f"0.4**2 - (x - 0.1)**2 - (y - 0.05)**2 - (z - {centre[2]})**2"
        ring = ck.source("cut.function", surface=surface, phi=phi)
        boundaries.append(ck.Boundary(name, ring, left=ck.Dirichlet(inside), right=ck.Dirichlet(outside)))
        centres[name] = centre
    return ck.Scene(surface, ck.Laplace(), boundaries), centres


def colour_errors(solution, vertices, centres, radius, margin):
    """Largest differences from the colour inside each ring, at the vertices there: it is the same everywhere."""
    values = solution.evaluate(vertices)
    errors = {}
    for curve in solution.scene.boundaries:
        if curve.name in centres:
            inside = np.linalg.norm(vertices - centres[curve.name], axis=1) < radius[curve.name] - margin
            assert inside.sum() > 20
            errors[curve.name] = np.abs(values[inside] - curve.condition("left").value).max()
    return errors


@pytest.mark.slow
def test_rings_on_both_faces_of_a_thin_part_keep_their_colours(thin_ellipsoid):
    scene, centres = discs(thin_ellipsoid, 0.35)
    vertices, _ = thin_ellipsoid.mesh(0.07)
    radius = dict.fromkeys(centres, 0.4)
    mixed = colour_errors(ck.solve(scene, 0.07, sheets=False), vertices, centres, radius, 0.01)
    kept = colour_errors(ck.solve(scene, 0.07, form="collocation"), vertices, centres, radius, 0.01)
    assert min(mixed.values()) > 0.2
    assert max(kept.values()) <= 1e-2


#: Centres and radii of the spheres that make the rings of the fish.
RINGS = {
    "back, near face": ((3.66, 0.70, -0.19), 0.26),
    "back, far face": ((3.09, 0.70, -0.19), 0.26),
    "side, outer face": ((4.22, 0.01, -0.25), 0.28),
    "root, near face": ((3.60, -0.05, -0.86), 0.24),
    "root, far face": ((3.01, -0.05, -0.86), 0.24),
}


#: What is positive to the left of its other curves, planes.
PLANES = {"head": lambda x: (x - [3.4, 0.2, 0.45]) @ [0, 0.2, 1], "tail": lambda x: x[:, 2] + 1.12}


def side_of(curve, points):
    """What is positive to the left of a curve of the fish."""
    if curve.name in PLANES:
        return PLANES[curve.name](points)
    centre, size = RINGS[curve.name]
    return size - np.linalg.norm(points - centre, axis=1)


def pinned(scene, vertices, faces, sides):
    """Linear elements on the triangles, with each side's colour at the ends of all edges that a curve cuts.

    ``sides`` holds for each curve what is positive to its left, at the vertices.
    """
    from scipy.sparse.linalg import splu

    laplacian = pytest.importorskip("potpourri3d").cotan_laplacian(vertices, faces)
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    values = np.full((len(vertices), 3), np.nan)
    for curve in scene.boundaries:
        signed = sides[curve.name]
        ends = np.unique(edges[np.prod(signed[edges], axis=1) < 0])
        left, right = (curve.condition(name).value for name in ("left", "right"))
        values[ends] = np.where(signed[ends, None] > 0, left, right)
    fixed = np.isfinite(values[:, 0])
    among = laplacian.tocsr()[~fixed]
    values[~fixed] = splu(among[:, ~fixed].tocsc()).solve(-among[:, fixed] @ values[fixed])
    return values


@pytest.mark.slow
def test_no_colour_crosses_the_fins_of_the_fish(example, real_mesh):
    """Without sheets the rings of the fin on the back are filled by the colours of the other face."""
    wanted = ck.load_scene(example("09-fish-fins.toml", "fish.obj"))
    vertices, faces = ck.read_mesh(real_mesh("fish.obj"))
    centres = {name: np.array(centre) for name, (centre, _) in RINGS.items()}
    radius = {name: size for name, (_, size) in RINGS.items()}
    sides = {curve.name: side_of(curve, vertices) for curve in wanted.scene.boundaries}
    reference = pinned(wanted.scene, vertices, faces, sides)
    clear = np.min([one.source.closest_point(vertices).distance for one in wanted.scene.boundaries], axis=0) > 0.1
    kept, mixed = (ck.solve(wanted.scene, 0.05, sheets=sheets, solver_tolerance=1e-8) for sheets in (True, False))
    assert max(colour_errors(kept, vertices, centres, radius, 0.01).values()) <= 5e-3
    spoilt = colour_errors(mixed, vertices, centres, radius, 0.01)
    assert min(spoilt[name] for name in ("back, near face", "back, far face", "root, near face")) > 0.5
    assert np.abs(kept.evaluate(vertices) - reference)[clear].max() <= 0.1
    assert np.abs(mixed.evaluate(vertices) - reference)[clear].max() > 0.5


@pytest.mark.slow
def test_no_colour_crosses_the_ear_of_nefertiti(example, real_mesh):
    """No vertex has a colour that lies outside of what the curves hold, nor that of another sheet."""
    trimesh = pytest.importorskip("trimesh")
    wanted = ck.load_scene(example("08-nefertitis-ear.toml", "nefertiti-lowres.obj"))
    mesh = trimesh.Trimesh(*ck.read_mesh(real_mesh("nefertiti-lowres.obj")), process=False)
    inside = np.linalg.norm(mesh.vertices - [-68, 3, 50], axis=1) < 49.5
    ear = mesh.submesh([np.flatnonzero(inside[mesh.faces].all(axis=1))], append=True).subdivide().subdivide()
    vertices, faces = np.array(ear.vertices), np.array(ear.faces)
    away = np.array([one.source.closest_point(vertices).distance for one in wanted.scene.boundaries])
    data = [curve.condition(side).value for curve in wanted.scene.boundaries for side in ("left", "right")]
    low, high = np.min(data, axis=0), np.max(data, axis=0)
    kept, mixed = (
        ck.solve(wanted.scene, wanted.spacing, sheets=sheets, solver_tolerance=1e-8) for sheets in (True, False)
    )
    # The sign of a distance means something beside its curve, and nothing on the ear's other face.
    sides = {
        curve.name: np.where(far < 2, kept.signed_distance(curve.name, vertices), np.nan)
        for curve, far in zip(wanted.scene.boundaries, away, strict=True)
    }
    reference = pinned(wanted.scene, vertices, faces, sides)
    clear = away.min(axis=0) > 2

    def off(solution):
        values = solution.evaluate(vertices)
        return np.maximum(values - high, low - values).max(), np.abs(values - reference)[clear].max()

    assert (np.array(off(kept)) <= [5e-3, 0.15]).all()
    assert (np.array(off(mixed)) > [2e-2, 0.4]).all()
