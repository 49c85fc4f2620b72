"""Surfaces are lit on whichever side is seen, whatever the winding of triangles and the signs of normals."""

import json
import re
import shutil
import subprocess
from dataclasses import replace
from importlib.resources import files

import numpy as np
import pytest

import cpmkit as ck
from cpmkit.plugin import vertex_normals

image = pytest.importorskip("matplotlib.image")
SPHERE = ck.source("analytic.sphere")


def wound_at_random(triangles):
    turned = np.random.default_rng(5).random(len(triangles)) < 0.5
    return np.where(turned[:, None], triangles[:, ::-1], triangles)


def test_normals_at_vertices_do_not_cancel_where_triangles_are_wound_against_each_other():
    points, triangles = SPHERE.mesh(0.2)
    normals = vertex_normals(points, wound_at_random(triangles))
    np.testing.assert_allclose(np.abs(np.einsum("vd,vd->v", normals, points)), 1, atol=0.02)
    np.testing.assert_allclose(np.einsum("vd,vd->v", vertex_normals(points, triangles), points), 1, atol=0.02)


def white_picture(surface, folder, **options):
    """Return the pixels (rows, columns) of a white surface, the background being white as well."""
    white = ck.solve(ck.Scene(surface, ck.ScreenedPoisson([1.0, 1.0, 1.0])), spacing=0.2)
    return pixels_of(white, folder, **options)


def pixels_of(solution, folder, **options):
    solution.picture(folder / "white.png", width=240, **options)
    return image.imread(folder / "white.png")[:, :, 0]


@pytest.mark.parametrize("light", ["shaded", "flat"])
def test_a_picture_is_the_same_whatever_the_winding_and_the_signs(tmp_path, light):
    white = ck.solve(ck.Scene(SPHERE, ck.ScreenedPoisson([1.0, 1.0, 1.0])), spacing=0.2)
    plain, mesh = pixels_of(white, tmp_path, light=light), white.display_mesh()
    signs = np.random.default_rng(6).choice([-1.0, 1.0], len(mesh.normals))
    rewound = replace(mesh, cells=wound_at_random(mesh.cells), normals=signs[:, None] * mesh.normals)
    object.__setattr__(white, "display_mesh", lambda: rewound)
    assert np.ptp(plain) > 0.25  # lit, or with an outline
    np.testing.assert_allclose(pixels_of(white, tmp_path, light=light), plain, atol=1.5 / 255)


def test_a_moebius_strip_is_as_bright_as_its_slope_says_and_has_no_line_where_its_sides_meet(tmp_path):
    strip = ck.source("parametric.moebius")
    above = {"view": (0, 0, 1), "up": "y"}
    bright = white_picture(strip, tmp_path, light="shaded", **above)
    outlined = white_picture(strip, tmp_path, light="flat", **above)
    points, triangles = strip.mesh(0.05)
    a, b, c = (points[triangles[:, k]] for k in range(3))
    face = np.cross(b - a, c - a)
    face /= np.linalg.norm(face, axis=1)[:, None] * np.where(face[:, 2:] < 0, -1, 1)
    middles = (a + b + c)[:, :2] / 3
    low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    inked = bright < 0.999
    box = [(np.flatnonzero(inked.any(axis=axis))[[0, -1]]) for axis in (0, 1)]  # columns, rows
    scale = (box[0][1] - box[0][0]) / (high - low)[0]
    columns = np.rint(box[0][0] + (middles[:, 0] - low[0]) * scale).astype(int)
    rows = np.rint(box[1][1] - (middles[:, 1] - low[1]) * scale).astype(int)
    steep = np.abs(face[:, 2]) < 0.75
    light = np.array([-0.35, 0.5, 1.0]) / np.linalg.norm([-0.35, 0.5, 1.0])
    slope = np.maximum(face @ light, 0)
    assert np.corrcoef(bright[rows, columns][~steep], slope[~steep])[0, 1] > 0.99
    assert np.abs(np.diff(bright, axis=1))[rows, columns - 1][~steep].max() < 0.25
    lines = np.argwhere(outlined < 0.9)
    assert len(lines) > 10
    middles = np.column_stack([rows, columns])
    nearest = np.linalg.norm(lines[:, None] - middles, axis=2).argmin(axis=1)
    assert steep[nearest].all()  # outlines run where the strip turns away alone


NODE = shutil.which("node")


@pytest.mark.skipif(NODE is None, reason="node, which runs the page's JavaScript, is not installed")
def test_a_page_lights_a_moebius_strip_alike_on_both_sides_of_the_line_where_they_meet():
    points, triangles = ck.source("parametric.moebius").mesh(0.2)
    page = files("cpmkit.view").joinpath("page.html").read_text(encoding="utf-8")
    (script,) = re.findall(r"<script>(.*?)</script>", page, re.DOTALL)
    function = script[script.index("function shaded") : script.index("function start")]
    target = f"shaded(new Float32Array({points.ravel().tolist()}), new Uint32Array({triangles.ravel().tolist()}))"
    output = "for (const k in found) found[k] = Array.from(found[k]); console.log(JSON.stringify(found));"
    for code in (f"new Function({json.dumps(script)})", f"{function}; const found = {target}; {output}"):
        done = subprocess.run([NODE, "-e", code], capture_output=True, text=True, check=True)  # the first parses all
    found = {name: np.array(values) for name, values in json.loads(done.stdout).items()}
    made, normals = found["points"].reshape(-1, 3), found["normals"].reshape(-1, 3)
    cells, owner = found["triangles"].reshape(-1, 3), found["owner"]
    assert 0 < len(owner) < len(points) / 4
    np.testing.assert_allclose(made, np.concatenate([points, points[owner]]), atol=1e-6)
    np.testing.assert_array_equal(np.concatenate([np.arange(len(points)), owner])[cells], triangles)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    a, b, c = (normals[cells[:, k]] for k in range(3))
    assert min(np.einsum("td,td->t", *pair).min() for pair in ((a, b), (b, c), (a, c))) > 0.8
    corners = made[cells]
    face = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    face /= np.linalg.norm(face, axis=1, keepdims=True)
    assert np.abs(np.einsum("tkd,td->tk", normals[cells], face)).min() > 0.9
