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
from cpmkit.scenefile.look import Look
from cpmkit.view.drawing import Shapes, draw
from cpmkit.view.marks import outlines
from cpmkit.view.raster import AMBIENT, LIGHT, facing_signs, pixels

pytest.importorskip("matplotlib")
SPHERE = ck.source("analytic.sphere")


def wound_at_random(triangles):
    turned = np.random.default_rng(5).random(len(triangles)) < 0.5
    return np.where(turned[:, None], triangles[:, ::-1], triangles)


def test_normals_at_vertices_do_not_cancel_where_triangles_are_wound_against_each_other():
    points, triangles = SPHERE.mesh(0.2)
    normals = vertex_normals(points, wound_at_random(triangles))
    np.testing.assert_allclose(np.abs(np.einsum("vd,vd->v", normals, points)), 1, atol=0.02)
    np.testing.assert_allclose(np.einsum("vd,vd->v", vertex_normals(points, triangles), points), 1, atol=0.02)


def drawing_of(surface, light):
    white = ck.solve(ck.Scene(surface, ck.ScreenedPoisson([1.0, 1.0, 1.0])), spacing=0.2)
    mesh = white.display_mesh()
    return draw(white, mesh, Look(), 240, light), np.ones((len(mesh.points), 3))


def test_a_picture_is_the_same_whatever_the_winding_and_the_signs():
    drawing, white = drawing_of(SPHERE, True)
    signs = np.random.default_rng(6).choice([-1.0, 1.0], len(drawing.normals))
    wound, signed = wound_at_random(drawing.triangles), signs[:, None] * drawing.normals
    other = replace(drawing, triangles=wound, normals=signed)
    first, second = (pixels(one, white, None, Shapes.join([])) for one in (drawing, other))
    assert np.ptp(first) > 0.4  # lit
    np.testing.assert_allclose(second, first, atol=1e-9)
    np.testing.assert_array_equal(outlines(other).points, outlines(drawing).points)


def test_a_moebius_strip_is_as_bright_as_its_slope_says_and_has_no_line_where_its_sides_meet():
    strip = ck.source("parametric.moebius")
    drawing = drawing_of(strip, True)[0]
    a, b, c = (drawing.points[drawing.triangles[:, k]] for k in range(3))
    face = np.cross(b - a, c - a)
    face /= np.linalg.norm(face, axis=1)[:, None] * np.where(face[:, 2:] < 0, -1, 1)
    signs = facing_signs(drawing.points, drawing.triangles, drawing.normals)
    turned = signs[:, :, None] * drawing.normals[drawing.triangles]
    assert np.einsum("tkd,td->tk", turned, face).min() > 0.9  # the strip bends slowly
    bright = AMBIENT + (1 - AMBIENT) * np.maximum(turned @ LIGHT, 0)
    assert np.ptp(bright, axis=1).max() < 0.25
    flat, _ = drawing_of(strip, False)
    lines = outlines(flat)
    middle = lines.points.reshape(-1, 4, 3).mean(axis=1)
    view = np.abs(face[:, 2])
    near = np.linalg.norm(middle[:, None, :2] - ((a + b + c) / 3)[None, :, :2], axis=2).argmin(axis=1)
    assert view[near].max() < 0.75  # outlines run where the strip turns away alone


NODE = shutil.which("node")


@pytest.mark.skipif(NODE is None, reason="node, which runs the page's JavaScript, is not installed")
def test_a_page_lights_a_moebius_strip_alike_on_both_sides_of_the_line_where_they_meet():
    points, triangles = ck.source("parametric.moebius").mesh(0.2)
    page = files("cpmkit.view").joinpath("page.html").read_text(encoding="utf-8")
    (script,) = re.findall(r"<script>(.*?)</script>", page, re.DOTALL)
    function = script[script.index("function shaded") : script.index("function start")]
    target = f"shaded(new Float32Array({points.ravel().tolist()}), new Uint32Array({triangles.ravel().tolist()}))"
    told = "for (const k in found) found[k] = Array.from(found[k]); console.log(JSON.stringify(found));"
    for code in (f"new Function({json.dumps(script)})", f"{function}; const found = {target}; {told}"):
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
