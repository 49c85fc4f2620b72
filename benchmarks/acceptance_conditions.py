"""Rows of benchmarks/acceptance.py on conditions: rims, both sides of curves, junctions, slits, curves in meshes."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from typing import Any

import numpy as np
from palm_mesh import palm
from plane_zones import junction, off, slit, solved, strips
from sphere_zones import coupled, errors, sphere_points, unlike
from test_conditions_on_a_plate import T, X, Y, positive
from test_hard_shapes import SLOPES, TURNS, shifted

import cpmkit as ck

Row = Iterator[tuple[str, float, float]]
#: Unknowns of the closed curves on meshes, and how many spacings finer the solution is that they are measured against.
UNKNOWNS, FINER = (5000, 20_000), 4


def hemisphere() -> Row:
    """U = x y on the upper half of a sphere: du/db = 0 on its rim's plane, and every kind of condition there."""
    at = sphere_points(3000)
    at[:, 2] = np.abs(at[:, 2])
    u = lambda x: x[:, 0] * x[:, 1] + x[:, 2]  # noqa: E731
    f = lambda x: 7 * x[:, 0] * x[:, 1] + 3 * x[:, 2]  # noqa: E731
    rims = {
        "Dirichlet": ck.Dirichlet(u),
        "Neumann": ck.Neumann(-1.0),
        "Robin": ck.Robin(1.0, 2.0, lambda x: 2 * u(x) - 1),
    }
    cap = ck.source("analytic.cap", height=0.0)
    for (kind, rim), (spacing, limit) in product(rims.items(), {0.2: 4e-4, 0.1: 6e-5, 0.05: 2e-5}.items()):
        scene = ck.Scene(cap, ck.ScreenedPoisson(f), edge=rim)
        shifts = np.random.default_rng(0).uniform(0, spacing, (2, 3))
        found = [ck.solve(scene, spacing, form="galerkin", origin=one).evaluate(at) - u(at) for one in shifts]
        yield (
            f"{kind}, h = {spacing:g}, rms error of the range",
            float(np.sqrt(np.mean(np.square(found))) / np.ptp(u(at))),
            limit,
        )


def both_sides() -> Row:
    """A circle of a sphere with every pair of conditions on its sides: rms errors of the range, two positions."""
    at = sphere_points()
    kinds = [*product(("dirichlet", "neumann", "1"), repeat=2), ("1e-3", "1e3"), ("1e6", "1e-6")]
    scenes: dict[str, list[Any]] = {
        "Dirichlet, Neumann, Robin in pairs": [unlike(*pair) for pair in kinds],
        "transmission 1 to 1000": [coupled(contrast, 0.0) for contrast in (1.0, 10.0, 1000.0, 1e-3)],
        "resistance 0.3 to 1e6": [coupled(a, r) for a, r in product((1.0, 1000.0), (0.3, 1e6))],
    }
    for (name, every), (spacing, limit) in product(scenes.items(), {0.2: 6e-4, 0.1: 1e-4}.items()):
        worst = 0.0
        for scene in every:
            found = []
            for k in range(2):
                origin = np.random.default_rng(k).uniform(0, spacing, 3)
                found.append(errors(ck.solve(scene, spacing, form="galerkin", origin=origin), at)[1])
            worst = max(worst, float(np.mean(found)))
        yield f"{name}, h = {spacing:g}, rms error", worst, limit


def junctions() -> Row:
    """Three and four curves that meet on a plate, materials up to 1 : 1000, rms errors of the range at h = 0.1."""
    for name, angles in (("Y", Y), ("T", T), ("X", X)):
        worst = 0.0
        for materials in ((1, 1, 1, 1), (1, 1000, 1, 1000), (1, 10, 100, 1000)):
            scene, value = junction(angles, materials[: len(angles)])
            worst = max(worst, off(solved(scene, 0.1), value)[1])
        yield f"{name}, h = 0.1, rms error", worst, 1e-4


def close_lines() -> Row:
    """Lines a tenth and a millionth of a spacing apart, one a twentieth from a rim: errors, and pivots below zero."""
    scenes = {f"lines {gap:g} h apart": strips(0.1, 0.1 + 0.1 * gap) for gap in (0.1, 1e-6)}
    scenes["line 0.05 h from a rim"] = strips(1 - 0.005)
    for name, (scene, value) in scenes.items():
        found = [solved(scene, 0.1, shift) for shift in range(3)]
        yield f"{name}, rms error", max(off(one, value)[1] for one in found), 1.5e-4
        yield f"{name}, positions with a pivot below zero", sum(not positive(one) for one in found), 0


def slits() -> Row:
    """A slit from the rim to the middle of a plate, where u goes like a root, rms errors of the range at h = 0.1."""
    for kind, plain in (("flux", 2e-3), ("value", 3.5e-3)):
        scene, value = slit(kind)
        yield f"{kind}, extended", off(solved(scene, 0.1), value)[1], plain
        yield f"{kind}, singular", off(solved(scene, 0.1, tips="singular"), value)[1], 1.5e-4


def arcs() -> Row:
    """Three arcs that meet in space, h = 0.05, ten positions: the worst rms error of the range."""
    ways = [[np.cos(turn), np.sin(turn), 0.0] for turn in TURNS]
    keys: dict[str, Any] = {"start": 0, "end": np.pi / 2, "x_axis": [0, 0, 1]}
    members = [ck.source("analytic.arc", normal=np.cross([0, 0, 1], way).tolist(), **keys) for way in ways]

    def u(x: Any) -> Any:
        apart = np.arctan2(x[:, 1], x[:, 0])[:, None] - TURNS
        own = np.abs((apart + np.pi) % (2 * np.pi) - np.pi).argmin(axis=1)
        s = np.arctan2(np.hypot(x[:, 0], x[:, 1]), x[:, 2])
        return np.cos(s) + SLOPES[own] * np.sin(s)

    s = np.linspace(0, np.pi / 2, 200)[:, None]
    at = np.concatenate([np.sin(s) * way + np.cos(s) * [0, 0, 1] for way in np.array(ways)])
    union = ck.source("union", members=members)
    found = [one.evaluate(at) - u(at) for one in shifted(union, lambda x: 2 * u(x), 0.05, 10, edge=ck.Dirichlet(u))]
    yield "worst of ten positions, rms error", max(np.sqrt(np.mean(one**2)) / np.ptp(u(at)) for one in found), 3e-4


def closed_curve_on(name: str, vertices: Any, faces: Any, point: Any, normal: Any) -> Row:
    """Yield the rms errors of -Lap u + u = 0 between values 1 and -1 on the sides of a plane's cut."""
    low, size = vertices.min(axis=0), np.ptp(vertices, axis=0).max()
    surface = ck.source("mesh.triangles", vertices=(vertices - low) / size, faces=faces, closest="faceted")
    cut = ck.source("cut.plane", surface=surface, point=point, normal=normal)
    curve = ck.Boundary("C", cut, left=ck.Dirichlet(1.0), right=ck.Dirichlet(lambda x: -1.0 + x[:, 0]))
    scene = ck.Scene(surface, ck.ScreenedPoisson(lambda x: np.cos(6 * x[:, 0]) + x[:, 1]), [curve])
    corners = (vertices - low)[faces] / size
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = 0.5 * np.linalg.norm(across, axis=1).sum()
    spacings = [float(np.sqrt(4.5 * area / count)) for count in UNKNOWNS]
    at = np.random.default_rng(0).permutation((vertices - low) / size)[:6000]
    at = at[cut.closest_point(at).distance > 1e-6]
    fine = ck.solve(scene, min(spacings) / FINER, form="galerkin").evaluate(at)
    for spacing, limit in zip(spacings, (0.5, 0.12), strict=True):
        found = []
        for k in range(2):
            solution = ck.solve(scene, spacing, form="galerkin", origin=np.random.default_rng(k).uniform(0, spacing, 3))
            found.append(solution.evaluate(at) - fine)
        size_now = solution.work.unknowns
        yield (
            f"{name}, {size_now:,} unknowns, rms error, %",
            float(100 * np.sqrt(np.mean(np.square(found))) / np.ptp(fine)),
            limit,
        )


def closed_curves() -> Row:
    """Unlike values on the sides of a closed curve on a palm, the koala and Spot, against a quarter of the spacing."""
    yield from closed_curve_on("palm", *palm(), [0.2, 0.5, 0.1], [0.1, 1.0, 0.05])
    for name, point, normal in (
        ("koala", [0.3, 0.5, 0.4], [0.1, 1.0, 0.2]),
        ("spot", [0.3, 0.5, 0.4], [0.1, 0.3, 1.0]),
    ):
        yield from closed_curve_on(name, *ck.read_mesh(f"{name}.obj"), point, normal)


def curves_into_meshes() -> Row:
    """Sections and drawn curves put into meshes: how many leave other zones or tips than topology says."""
    from cut_meshes import cut, data_mesh, mean_edge, zones_and_tips
    from test_curves_by_closest_points import CASES as BOXES
    from test_curves_by_closest_points import ClosestPointsAlone
    from test_curves_on_real_meshes import drawn_curves, wrong_sections
    from test_junctions_and_rims import CASES, PLATE

    wrong, tried = wrong_sections(data_mesh("spot.obj"), range(200))
    yield f"sections of Spot, wrong of {tried}, %", 100 * len(wrong) / tried, 1
    mesh = data_mesh("nefertiti-lowres.obj")
    for share in (0.0, 0.5, 1.0):
        shift = share * mean_edge(mesh) * np.array([0.6, -0.64, 0.48])
        found = zones_and_tips(cut(mesh, *drawn_curves("nefertiti", shift)).mesh)
        yield (
            f"Nefertiti's curves, {share:g} edges off, wrong zones and tips",
            abs(found[0] - 11) + abs(found[1] - 8),
            0,
        )
    alone = [cut(PLATE, ClosestPointsAlone(one), spacing=0.05).mesh for one, _ in BOXES.values()]
    bad = sum(zones_and_tips(mesh) != expected for mesh, (_, expected) in zip(alone, BOXES.values(), strict=True))
    yield f"curves by closest points alone, wrong of {len(BOXES)}", bad, 0
    bad = sum(
        zones_and_tips(cut(PLATE, *sources, spacing=0.05).mesh) != expected for sources, expected in CASES.values()
    )
    yield f"junctions, rims and coincident curves, wrong of {len(CASES)}", bad, 0


ROWS = {
    "hemisphere": hemisphere,
    "both-sides": both_sides,
    "junctions": junctions,
    "close-lines": close_lines,
    "slits": slits,
    "arcs": arcs,
    "closed-curves": closed_curves,
    "curves-into-meshes": curves_into_meshes,
}
