"""Meshes as they come: doubled, flipped, torn, touching, with specks; thin plates and folds are told."""

from functools import cache

import numpy as np
import pytest
from cut_meshes import icosphere
from galerkin_scenes import fold, plate

import cpmkit as ck
from cpmkit.forms.galerkin.dof_map import connected_pieces

BALL = icosphere(4)
VERTICES, FACES = BALL.vertices, BALL.cells
SPACING = 0.2
RNG = np.random.default_rng(0)


def xy(x):
    return x[:, 0] * x[:, 1]


def form_of(vertices, faces, f=lambda x: 7 * xy(x), spacing=SPACING):
    source = ck.source("mesh.triangles", vertices=vertices, faces=faces, closest="faceted")
    return ck.prepare(ck.Scene(source, ck.ScreenedPoisson(f)), spacing, form="galerkin", solver="direct")


def solved(vertices, faces, f=lambda x: 7 * xy(x)):
    return form_of(vertices, faces, f).solve()


@cache
def clean():
    return solved(VERTICES, FACES)


def rms(solution):
    return np.sqrt(np.mean((solution.evaluate(VERTICES[::7]) - xy(VERTICES[::7])) ** 2))


def flipped():
    some = (RNG.random(len(FACES)) < 0.5)[:, None]
    return VERTICES, np.where(some, FACES[:, ::-1], FACES)


def doubled():
    return VERTICES, np.concatenate([FACES, FACES[::3], FACES[::3, ::-1]])


def soup():
    """Every triangle has vertices of its own, 1e-7 off."""
    vertices = VERTICES[FACES].reshape(-1, 3)
    return vertices + 1e-7 * RNG.normal(size=vertices.shape), np.arange(len(vertices)).reshape(-1, 3)


def torn(noise):
    """Two halves whose seam is not welded."""
    faces = FACES + len(VERTICES) * (VERTICES[FACES].mean(axis=1)[:, :1] > 0)
    return np.concatenate([VERTICES, VERTICES + noise * RNG.normal(size=VERTICES.shape)]), faces


def with_t_junctions():
    """Every tenth triangle is halved, its neighbour over the halved edge is not."""
    a, b, c = FACES[::10].T
    new = len(VERTICES) + np.arange(len(a))
    halves = np.concatenate([np.stack([a, new, c], axis=1), np.stack([new, b, c], axis=1)])
    rest = np.delete(FACES, np.s_[::10], axis=0)
    return np.concatenate([VERTICES, 0.5 * (VERTICES[a] + VERTICES[b])]), np.concatenate([rest, halves])


def with_slivers():
    """Every tenth triangle is split at a point 1e-9 beside an edge."""
    a, b, c = FACES[::10].T
    new = len(VERTICES) + np.arange(len(a))
    parts = [np.stack(three, axis=1) for three in ((a, b, new), (b, c, new), (c, a, new))]
    beside = (1 - 1e-9) * 0.5 * (VERTICES[a] + VERTICES[b]) + 1e-9 * VERTICES[c]
    return np.concatenate([VERTICES, beside]), np.concatenate([np.delete(FACES, np.s_[::10], axis=0), *parts])


@pytest.mark.filterwarnings("ignore::cpmkit.CpmkitWarning")
@pytest.mark.parametrize("made", [flipped, doubled, soup, lambda: torn(1e-7), with_slivers])
def test_what_is_not_sound_does_no_harm(made):
    dirty = solved(*made())
    assert rms(dirty) == pytest.approx(rms(clean()), rel=0.02)
    assert connected_pieces(dirty.discretized.space.dof_map)[0] == 1
    area = [one.discretized.sampled.samples.weights.sum() for one in (clean(), dirty)]
    assert area[1] == pytest.approx(area[0], rel=1e-6)


def test_a_seam_that_is_not_welded_gives_a_warning():
    with pytest.warns(ck.CpmkitWarning, match=r"edges of rims lie on other rims, the first near .*weld the vertices"):
        solution = solved(*torn(1e-4))
    assert connected_pieces(solution.discretized.space.dof_map)[0] == 2


def test_t_junctions_are_joined_and_the_error_stays_within_a_factor_of_three():
    with pytest.warns(ck.CpmkitWarning, match="these T-junctions were joined"):
        solution = solved(*with_t_junctions())
    assert connected_pieces(solution.discretized.space.dof_map)[0] == 1
    assert not any("other rims" in text for text in solution.warnings)
    assert rms(solution) < 3 * rms(clean())


def test_rims_apart_and_a_mesh_that_is_closed_have_no_seam():
    open_ball = FACES[np.abs(VERTICES[FACES].mean(axis=1)[:, 2]) > 0.05]
    for faces in (FACES, open_ball):
        assert not any("other rims" in message for message in form_of(VERTICES, faces).discretized.warnings())


def test_spheres_that_touch_at_a_vertex_share_nothing():
    at = int(VERTICES[:, 0].argmax())
    other = 2 * VERTICES[at] - VERTICES
    faces = FACES + len(VERTICES)
    faces[faces == at + len(VERTICES)] = at

    def sign(x):
        return np.where(x @ VERTICES[at] < 1, 1.0, -1.0)

    vertices = np.concatenate([VERTICES, other])
    with pytest.warns(ck.CpmkitWarning, match="touch at 1 vertices"):
        solution = solved(vertices, np.concatenate([FACES, faces]), sign)
    read = np.delete(vertices, [at, at + len(VERTICES)], axis=0)
    np.testing.assert_allclose(solution.evaluate(read), sign(read), atol=1e-10)


@pytest.mark.parametrize("solver", ["direct", "multigrid"])
def test_fifty_specks_give_a_warning_and_do_no_harm(solver):
    tiny, centres = icosphere(1), RNG.normal(size=(50, 3))
    centres *= 1.6 / np.linalg.norm(centres, axis=1)[:, None]
    vertices = np.concatenate([VERTICES, *(one + 0.02 * tiny.vertices for one in centres)])
    starts = len(VERTICES) + len(tiny.vertices) * np.arange(50)
    faces = np.concatenate([FACES, *(tiny.cells + start for start in starts)])
    source = ck.source("mesh.triangles", vertices=vertices, faces=faces, closest="faceted")
    scene = ck.Scene(source, ck.ScreenedPoisson(lambda x: 7 * xy(x)))
    with pytest.warns(ck.CpmkitWarning, match="50 pieces of the manifold are smaller than 2 spacings"):
        solution = ck.solve(scene, SPACING, form="galerkin", solver=solver)
    assert rms(solution) == pytest.approx(rms(clean()), rel=0.1)
    on_specks = centres + [0.0, 0.0, 0.02]
    np.testing.assert_allclose(solution.evaluate(on_specks), 7 * xy(centres), rtol=0.2, atol=0.05)


@pytest.mark.parametrize("mesh", [*(plate(0.05 * share) for share in (1, 0.4, 0.1)), *map(fold, (90, 45, 20, 5, 2))])
def test_thin_plates_and_folds_are_tied_and_give_no_warning(mesh):
    form = form_of(*mesh, spacing=0.05).discretized
    assert len(form.sampled.tied)
    assert not form.warnings()
    assert form.diagnosis().order > 1.5
