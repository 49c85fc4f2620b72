"""Conditions on one sheet of a surface hold there and nowhere else, however near the other sheets are."""

from functools import partial

import numpy as np
import pytest
from model_problems import max_error, order_of

import cpmkit as ck

KINDS = ("dirichlet", "neumann", "robin", "transmission")


class Spiral:
    """The radius grows by ``gap`` in each turn, from one; position, angle and travelled length along it."""

    def __init__(self, gap, turns):
        self.rate, self.end = gap / (2 * np.pi), 2 * np.pi * turns
        self.x = [f"(1 + {self.rate!r}*u)*cos(u)", f"(1 + {self.rate!r}*u)*sin(u)"]
        self.length = self.travelled(self.end)

    def at(self, angle):
        radius = 1 + self.rate * np.asarray(angle)
        return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1)

    def angle(self, x):
        """Unwrapped: the radius tells the turn only, for points a little off the curve."""
        direction = np.arctan2(x[:, 1], x[:, 0])
        turn = ((np.hypot(x[:, 0], x[:, 1]) - 1) / self.rate - direction) / (2 * np.pi)
        return direction + 2 * np.pi * np.round(turn)

    def travelled(self, angle):
        def primitive(r):
            return (r * np.hypot(r, self.rate) + self.rate**2 * np.arcsinh(r / self.rate)) / (2 * self.rate)

        return primitive(1 + self.rate * np.asarray(angle)) - primitive(1.0)


def conditions(kind, left, right, slope_left, slope_right):
    """Data of functions of points on a boundary: values, and slopes out of each side."""
    if kind == "dirichlet":
        return {"left": ck.Dirichlet(left), "right": ck.Dirichlet(right)}
    if kind == "neumann":
        return {"left": ck.Neumann(slope_left), "right": ck.Neumann(slope_right)}
    if kind == "robin":
        return {
            "left": ck.Robin(1.0, 2.0, lambda x: slope_left(x) + 2 * left(x)),
            "right": ck.Robin(1.0, 2.0, lambda x: slope_right(x) + 2 * right(x)),
        }
    jump, flux = (lambda x: left(x) - right(x)), (lambda x: slope_left(x) + slope_right(x))
    return {"across": ck.Transmission(jump=jump, flux=flux)}


def cut_spiral(kind, gap):
    """-u'' + u = f on two turns of a spiral, cut at three points, of which two are opposite each other.

    u is cos k s plus 3, -6, 9, -12 on the four pieces.
    """
    spiral = Spiral(gap, turns=2)
    cuts = np.array([0.7, 3.0, 0.7 + 2 * np.pi])
    at, constants, k = spiral.travelled(cuts), np.array([3.0, -6.0, 9.0, -12.0]), 4 * np.pi / spiral.length

    def u(x, amplitude=1.0):
        s = spiral.travelled(spiral.angle(x))
        return amplitude * np.cos(k * s) + constants[np.searchsorted(at, s)]

    def near(value):
        return lambda x: np.full(len(x), value)

    boundaries = []
    for number, (angle, s) in enumerate(zip(cuts, at, strict=True)):
        value, slope = np.cos(k * s), -k * np.sin(k * s)
        sides = (near(value + constants[number]), near(value + constants[number + 1]), near(slope), near(-slope))
        point = ck.source("analytic.point", at=spiral.at(angle))
        boundaries.append(ck.Boundary(f"cut {number}", point, **conditions(kind, *sides)))
    curve = ck.source("parametric.curve", x=[one.replace("u", "t") for one in spiral.x], range=[0, spiral.end])
    angles = np.linspace(0, spiral.end, 3000)
    points = spiral.at(angles[np.abs(angles[:, None] - cuts).min(axis=1) > 1e-3])
    f = partial(u, amplitude=1 + k * k)
    return ck.Scene(curve, ck.ScreenedPoisson(f, c=1.0), boundaries), points, u(points)


@pytest.mark.parametrize(
    ("kind", "gap"),
    [
        ("dirichlet", 1.5),
        ("transmission", 2),
        *[pytest.param(kind, gap, marks=pytest.mark.slow) for kind in KINDS for gap in (1.5, 2, 3)],
    ],
)
def test_cuts_of_a_spiral(kind, gap):
    """The turns draw nearer with the spacing; the error is that of a curve by itself, of second order."""
    for h in (0.05, 0.025, 0.0125):
        assert max_error(*cut_spiral(kind, gap * h), h) <= 1e-3 * (h / 0.05) ** 2


def test_plain_closest_points_mix_the_turns_of_a_cut_spiral():
    for h in (0.05, 0.025):
        assert max_error(*cut_spiral("dirichlet", 2 * h), h, sheets=False) > 5


def rolled_sheet(kind, curve, gap, turns=1.2, height=0.5):
    """-Lap u + u = f on a sheet rolled up to a spiral, u a product of cosines that jumps by 10 across a curve.

    The curve runs along the axis, on one turn, or winds up with the sheet through all turns and grows by 0.03 each
    radian: its nearest part is then often on a neighbouring turn.
    """
    spiral = Spiral(gap, turns)
    k, m = 4 * np.pi / spiral.length, np.pi / height
    surface = ck.source("parametric.surface", x=[*spiral.x, "v"], u=[0, spiral.end], v=[0, height])
    if curve == "axis":
        foot = spiral.at(0.9)
        line = ck.source("analytic.segment", start=[*foot, 0.0], end=[*foot, height])
    else:
        winding = [one.replace("u", "t") for one in spiral.x]
        line = ck.source("parametric.curve", x=[*winding, "0.15 + 0.03*t"], range=[0, spiral.end])

    def to_left(x):
        """The unit vector to the left in arc length and height."""
        if curve == "axis":
            return -1.0, 0.0
        rise = 0.03 / np.hypot(1 + spiral.rate * spiral.angle(x), spiral.rate)
        return -rise / np.hypot(1, rise), 1 / np.hypot(1, rise)

    def side(x):
        angle = spiral.angle(x)
        return 0.9 - angle if curve == "axis" else x[:, 2] - 0.15 - 0.03 * angle

    def smooth(x):
        return np.cos(k * spiral.travelled(spiral.angle(x))) * np.cos(m * x[:, 2])

    def slope(x, sign):
        s, z = k * spiral.travelled(spiral.angle(x)), m * x[:, 2]
        along, up = to_left(x)
        return sign * (-k * np.sin(s) * np.cos(z) * along - m * np.cos(s) * np.sin(z) * up)

    def u(x, amplitude=1.0):
        return amplitude * smooth(x) + np.where(side(x) > 0, 5.0, -5.0)

    data = (lambda x: smooth(x) + 5, lambda x: smooth(x) - 5, partial(slope, sign=-1.0), partial(slope, sign=1.0))
    boundary = ck.Boundary("line", line, **conditions(kind, *data))
    angle, z = (one.ravel() for one in np.meshgrid(np.linspace(0, spiral.end, 300), np.linspace(0, height, 40)))
    points = np.concatenate([spiral.at(angle), z[:, None]], axis=1)
    points = points[np.abs(side(points)) > 1e-3]
    f = partial(u, amplitude=1 + k * k + m * m)
    return ck.Scene(surface, ck.ScreenedPoisson(f, c=1.0), [boundary]), points, u(points)


def test_a_curve_on_one_turn_of_a_rolled_sheet():
    """The jump is 10: that is the error where the next turn shares it."""
    h = 0.1
    problem = rolled_sheet("dirichlet", "axis", 2 * h)
    assert max_error(*problem, h) <= 0.05
    assert max_error(*problem, h, sheets=False) > 5


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_curves_on_one_turn_of_a_rolled_sheet(kind):
    spacings = (0.1, 0.07, 0.05)
    errors = [max_error(*rolled_sheet(kind, "axis", 2 * h), h) for h in spacings]
    assert order_of(spacings, errors) >= 1.6


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_a_curve_that_winds_up_with_a_rolled_sheet(kind):
    """As exact as where the turns are ten spacings apart, so that nothing is shared."""
    for h in (0.1, 0.05):
        alone = max_error(*rolled_sheet(kind, "winding", 10 * h), h)
        assert max_error(*rolled_sheet(kind, "winding", 2 * h), h) <= 1.2 * alone


@pytest.fixture(scope="module")
def thin_ellipsoid():
    """A smooth mesh of the ellipsoid 1 : 1 : 0.1."""
    points, cells = ck.source("analytic.sphere").mesh(0.08)
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
    assert parted(ck.solve(scene, 0.07), normal) <= 1e-6
    if normal == (1, 0.2, 2):
        assert parted(ck.solve(scene, 0.07, sheets=False), normal) > 0.5


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


def test_rings_on_both_faces_of_a_thin_part_keep_their_colours(thin_ellipsoid):
    scene, centres = discs(thin_ellipsoid, 0.35)
    vertices, _ = thin_ellipsoid.mesh(0.07)
    radius = dict.fromkeys(centres, 0.4)
    mixed = colour_errors(ck.solve(scene, 0.07, sheets=False), vertices, centres, radius, 0.01)
    kept = colour_errors(ck.solve(scene, 0.07), vertices, centres, radius, 0.01)
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


def pinned(scene, vertices, faces, side):
    """Linear elements on the triangles, with each side's colour at the ends of all edges that a curve cuts."""
    from scipy.sparse.linalg import splu

    laplacian = pytest.importorskip("potpourri3d").cotan_laplacian(vertices, faces)
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    values = np.full((len(vertices), 3), np.nan)
    for curve in scene.boundaries:
        signed = side(curve, vertices)
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
    reference = pinned(wanted.scene, vertices, faces, side_of)
    clear = np.min([one.source.closest_point(vertices).distance for one in wanted.scene.boundaries], axis=0) > 0.1
    kept, mixed = (ck.solve(wanted.scene, 0.05, sheets=sheets, tolerance=1e-8) for sheets in (True, False))
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
    kept, mixed = (ck.solve(wanted.scene, wanted.spacing, sheets=sheets, tolerance=1e-8) for sheets in (True, False))

    def side(curve, points):
        """Beside the curve: on the ear's other face the sign means nothing."""
        return np.where(
            curve.source.closest_point(points).distance < 2, kept.signed_distance(curve.name, points), np.nan
        )

    reference = pinned(wanted.scene, vertices, faces, side)
    clear = away.min(axis=0) > 2

    def off(solution):
        values = solution.evaluate(vertices)
        return np.maximum(values - high, low - values).max(), np.abs(values - reference)[clear].max()

    assert (np.array(off(kept)) <= [5e-3, 0.15]).all()
    assert (np.array(off(mixed)) > [2e-2, 0.4]).all()
