"""Drawings: colours of sides and along paths, groups, what is refused, and the picture."""

from __future__ import annotations

import numpy as np
import pytest
from cpmkit_svg import draw, drawing_scene, path, read_drawing
from cpmkit_svg.__main__ import main
from cpmkit_svg.clipping import clip_polyline

import cpmkit as ck
from cpmkit.errors import InputError

HEAD = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 40 20">'
GRADIENT = (
    '<linearGradient id="g" gradientUnits="userSpaceOnUse"><stop offset="0" stop-color="red"/>'
    '<stop offset="25%" style="stop-color:#00ff00"/><stop offset="1" stop-color="rgb(0, 0, 255)"/></linearGradient>'
)


#: Encodings that the parser refuses: unknown, not of text, or of several bytes a character.
ENCODINGS = ("x-unknown", "rot13", "utf-7", "idna", "punycode")


@pytest.fixture
def write(tmp_path):
    def written(body: str, head: str = HEAD):
        file = tmp_path / "drawing.svg"
        file.write_text(f"{head}{body}</svg>")
        return file

    return written


def test_a_drawing_stands_upright_and_left_is_at_the_left_hand(write):
    """A line to the right across the whole canvas and beyond, near its top: left is above it."""
    file = write('<path id="sky" d="M -1 5 H 41" data-left="white" data-right="navy"/>')
    values = ck.solve(drawing_scene(file), 1.0).evaluate([[20, 18], [20, 2]])
    np.testing.assert_allclose(values, [[1, 1, 1], [0, 0, 128 / 255]], atol=1e-6)
    np.testing.assert_allclose(path(file=file, id="sky").vertices, [[-1, 15], [41, 15]])


def test_stops_are_shares_of_the_length(write):
    file = write(f'{GRADIENT}<polyline points="4 10 14 10 14 16 38 16" stroke="url(#g)"/>')
    (boundary,) = drawing_scene(file).boundaries
    found = boundary.both.value(np.array([[4, 10.0], [14, 10], [14, 4], [38, 4]]))
    shares = np.array([0, 10, 16, 40]) / 40
    stops = np.interp(shares, [0, 0.25, 1], [0, 1, 2])
    exact = np.maximum(1 - np.abs(stops[:, None] - [0, 1, 2]), 0)
    np.testing.assert_allclose(found, exact, atol=1e-12)


def test_curves_are_cut_off_at_the_canvas_and_keep_their_shares():
    angle = np.linspace(0, 2 * np.pi, 401)
    circle = np.stack([2 * np.cos(angle), 2 * np.sin(angle)], axis=1)
    found = clip_polyline(circle, np.array([-3.0, -1.0]), np.array([3.0, 1.0]))
    assert len(found) == 3  # it begins inside, on the right
    for one in found:
        at = np.arctan2(one.points[:, 1], one.points[:, 0]) % (2 * np.pi) / (2 * np.pi)
        np.testing.assert_allclose((at - one.shares + 0.5) % 1, 0.5, atol=1e-4)
        assert (np.abs(one.points[:, 1]) <= 1).all()
        assert np.abs(one.points[[0, -1], 1]).max() == 1.0
    total = sum(one.shares[-1] - one.shares[0] for one in found)
    assert total == pytest.approx(2 / 3 * 0.5, rel=1e-3)
    assert clip_polyline(circle, np.array([5.0, 5.0]), np.array([6.0, 6.0])) == []


def test_groups_pass_on_transforms_and_colours(write):
    file = write(
        '<g transform="translate(10 0) scale(2)" stroke="red">'
        '<g style="stroke: lime"><circle id="c" cx="2" cy="4" r="1"/></g>'
        '<rect x="1" y="1" width="2" height="1" stroke="none"/><line x1="0" y1="0" x2="1" y2="1" display="none"/></g>'
    )
    circle, rectangle = read_drawing(file).curves
    assert (circle.name, circle.closed, rectangle.coloured) == ("c", True, False)
    np.testing.assert_allclose(np.linalg.norm(circle.points - [14, 12], axis=1), 2.0, atol=1e-4)
    np.testing.assert_array_equal(circle.left.colours, [[0, 1, 0]])
    assert [one.name for one in drawing_scene(file).boundaries] == ["c"]


def test_a_scene_file_names_a_path(write, tmp_path):
    write('<path id="way" d="M 4 4 C 10 20 30 -10 36 4"/><path id="two" d="M 0 0 L 1 1 M 2 2 L 3 3"/>')
    scene = tmp_path / "scene.toml"
    scene.write_text(
        '[surface]\nkind = "analytic.box"\nlower = [0, 0]\nupper = [40, 20]\n'
        '[[boundary]]\nname = "way"\nkind = "svg.path"\nfile = "drawing.svg"\nid = "way"\nboth = { dirichlet = 1.0 }\n'
        '[problem]\nkind = "laplace"\n'
    )
    (boundary,) = ck.load_scene(scene).scene.boundaries
    np.testing.assert_allclose(boundary.source.vertices[[0, -1]], [[4, 16], [36, 16]])
    np.testing.assert_allclose(path(file=tmp_path / "drawing.svg", id="two", subpath=1).vertices, [[2, 18], [3, 17]])


def test_the_picture_has_the_colours_of_the_sides(write, tmp_path):
    from matplotlib.image import imread

    file = write('<circle cx="20" cy="10" r="7" data-left="gold" data-right="teal"/>')
    assert main([str(file), str(tmp_path / "out.png"), "--width", "80", "--spacing", "1"]) == 0
    image = imread(tmp_path / "out.png")[..., :3]
    assert image.shape == (40, 80, 3)
    inside = image[20, 40], image[20, 5]  # the circle runs clockwise as one sees it: inside is right
    np.testing.assert_allclose(inside, np.array([[0, 128, 128], [255, 215, 0]]) / 255, atol=0.01)


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ("<text>hello</text>", "text is no curve"),
        ('<use href="#a"/>', "use is no curve"),
        ("<style>path { stroke: red }</style>", "style sheets are not read"),
        ('<path id="a" d="M 0 0 L 1 1" stroke="url(#none)"/>', "which is no gradient of the drawing"),
        ('<linearGradient id="g"/><path d="M 0 0 L 1 1" stroke="url(#g)"/>', "whose stops are nowhere|no gradient"),
        ('<path d="M 0 0 L 1 1" stroke="reed"/>', "did you mean 'red'"),
        ('<path d="M 0 0 L 1 1"/>', "no curve of the drawing has a stroke"),
        ('<path d="M 0 0 L 1" stroke="red"/>', "number was expected at character 10"),
        ('<circle r="1cm" stroke="red"/>', "or one with px after it, got '1cm'"),
        ('<rect rx="1" width="3" height="3" stroke="red"/>', "rounded corners"),
        ('<path d="M 0 0 L 1e300 1" stroke="red"/>', "number of at most 3.4e.38 was expected at character 8"),
        ('<circle r="1e400" stroke="red"/>', "r of .* must be a number, .* got '1e400'"),
        (GRADIENT.replace("25%", "nan") + '<path d="M 0 0 L 1 1" stroke="url(#g)"/>', "offset of .*, got 'nan'"),
    ],
)
def test_what_would_be_missed_is_refused(write, body, words):
    with pytest.raises(InputError, match=rf"({words})"):
        drawing_scene(write(body))


@pytest.mark.parametrize(
    ("head", "words"),
    [
        ('<!DOCTYPE svg [<!ENTITY a SYSTEM "file:///etc/passwd">]>' + HEAD, "has a document type"),
        ('<!DOCTYPE svg [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;">]>' + HEAD, "has a document type"),
        ("<svg>", "holds 'svg'|neither a viewBox"),
        ('<svg xmlns="http://www.w3.org/2000/svg">', "neither a viewBox nor width"),
        (HEAD + "<g>", "no well-formed XML"),
        (HEAD + "&a;", "no well-formed XML"),
        (HEAD + "<g>" * 300, "in each other"),
        *[(f'<?xml version="1.0" encoding="{name}"?>{HEAD}', "no well-formed XML") for name in ENCODINGS],
    ],
)
def test_files_that_could_harm_or_are_damaged_are_refused(write, head, words):
    with pytest.raises(InputError, match=rf"({words})"):
        read_drawing(write("", head))


def test_large_files_are_refused(write, monkeypatch):
    monkeypatch.setattr("cpmkit_svg.xml_tree.MOST_BYTES", 100)
    with pytest.raises(InputError, match="larger than"):
        read_drawing(write(" " * 200))


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({}, "takes a file"),
        ({"d": "M 0 0 L 1 1", "file": "a.svg"}, "takes a file"),
        ({"d": "M 0 0"}, "draw no curve"),
        ({"d": "M 0 0 L 1 1 M 2 2 L 3 3"}, "draws 2 curves; give subpath from 0 to 1"),
        ({"d": "M 0 0 L 1 1", "subpath": 1}, "subpath must be a whole number from 0 to 0"),
    ],
)
def test_wrong_keys_are_answered_in_one_sentence(keys, words):
    with pytest.raises(InputError, match=words):
        path(**keys)


def test_a_path_that_is_not_there_is_answered_with_those_that_are(write):
    file = write('<path id="a" d="M 0 0 L 1 1"/><path id="b" d="M 0 0 L 1 1"/>')
    with pytest.raises(InputError, match="the ids of those that are drawn are 'a', 'b'"):
        path(file=file, id="c")
    with pytest.raises(InputError, match="draws 2 curves; give its id"):
        path(file=file)


def test_the_command_says_what_is_wrong(write, tmp_path, capsys):
    assert main([str(write("<text/>")), str(tmp_path / "out.png")]) == 1
    assert "text is no curve" in capsys.readouterr().err
    with pytest.raises(InputError, match=r"must be a \.png file"):
        draw(tmp_path / "drawing.svg", tmp_path / "out.jpg")
