"""Mesh files of any sort: a mesh as it is written, or a CpmkitError; and what reads is a source that answers."""

import struct

import numpy as np
import pytest
from fuzzing import answered, corpus, long, short
from hypothesis import given
from hypothesis import strategies as st

import cpmkit as ck

SUFFIXES = ("obj", "ply", "stl", "off")
WORDS = st.sampled_from(
    ["v", "f", "vt", "vn", "l", "o", "g", "#", "OFF", "COFF", "ply", "format", "ascii", "1.0", "element", "property"]
    + ["list", "uchar", "int", "float", "vertex", "face", "vertex_indices", "x", "y", "z", "end_header", "solid"]
    + ["facet", "normal", "outer", "loop", "vertex", "endloop", "endfacet", "endsolid", "0", "1", "2", "3", "4", "-1"]
    + ["1/1/1", "2//2", "1e9", "nan", "inf", "-0", "1e308", "5e-324", "0x1", "1_0", "9" * 20, "\\", ",", "é"]
)
JUNK = st.lists(st.lists(WORDS, max_size=8).map(" ".join), max_size=20).map(lambda lines: "\n".join(lines).encode())
COORDINATES = st.one_of(st.integers(-2, 2).map(float), st.floats(-1, 1), st.floats())


@st.composite
def triangles(draw):
    """Return vertices (n, 3) and faces (m, 3): small, often degenerate."""
    count = draw(st.integers(3, 8))
    points = draw(st.lists(st.tuples(COORDINATES, COORDINATES, COORDINATES), min_size=count, max_size=count))
    corner = st.integers(0, count - 1)
    return points, draw(st.lists(st.tuples(corner, corner, corner), min_size=1, max_size=10))


def as_obj(points, faces):
    lines = ["v {!r} {!r} {!r}".format(*point) for point in points]
    return "\n".join(lines + ["f {} {} {}".format(*(k + 1 for k in face)) for face in faces]).encode()


def as_off(points, faces):
    rows = [f"OFF\n{len(points)} {len(faces)} 0", *("{!r} {!r} {!r}".format(*point) for point in points)]
    return "\n".join(rows + ["3 {} {} {}".format(*face) for face in faces]).encode()


def as_ply(points, faces):
    head = "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty double x\nproperty double y\n"
    head += "property double z\nelement face {}\nproperty list uchar int vertex_indices\nend_header\n"
    body = b"".join(struct.pack("<ddd", *point) for point in points)
    return head.format(len(points), len(faces)).encode() + body + b"".join(struct.pack("<Biii", 3, *f) for f in faces)


def as_stl(points, faces):
    corners = np.array(points)[np.array(faces)].clip(-3e38, 3e38).astype("<f4")
    rows = b"".join(bytes(12) + corner.tobytes() + bytes(2) for corner in corners)
    return bytes(80) + struct.pack("<I", len(faces)) + rows


WRITERS = {"obj": as_obj, "off": as_off, "ply": as_ply, "stl": as_stl}


@st.composite
def damaged(draw):
    """Return a suffix and a file of its format with a few bytes changed, or cut off, or of words at random."""
    suffix = draw(st.sampled_from(SUFFIXES))
    data = bytearray(draw(st.one_of(JUNK, triangles().map(lambda mesh: WRITERS[suffix](*mesh)))))
    for place, value in draw(st.lists(st.tuples(st.integers(0, 1000), st.integers(0, 255)), max_size=3)):
        if data:
            data[place % len(data)] = value
    return suffix, bytes(data[: draw(st.integers(0, len(data)))] if draw(st.booleans()) else data)


def check_file(folder, suffix, data):
    file = folder / f"a.{suffix}"
    file.write_bytes(data)
    read = answered(lambda: ck.read_mesh(file))
    if isinstance(read, tuple):
        check_mesh(*read)


def check_mesh(vertices, faces):
    """Ask a mesh for closest points and warnings, as far as it is one."""
    source = answered(lambda: ck.source("mesh.triangles", vertices=vertices, faces=faces))
    if isinstance(source, Exception):
        return
    lower, upper = source.bounds
    x = lower + np.random.default_rng(0).uniform(-0.5, 1.5, (20, 3)) * max((upper - lower).max(), 1e-9)
    feet = source.closest_point(x)
    assert np.isfinite(feet.points).all()
    size = max((upper - lower).max(), np.abs(source.bounds).max())
    assert (feet.points >= lower - 1e-6 * size).all()
    assert (feet.points <= upper + 1e-6 * size).all()
    assert all(text.endswith(".") for text in source.advice(0.1 * float((upper - lower).max())).warnings)
    assert np.isfinite(source.interpolate(np.ones(len(vertices)), feet)).all()


@short
@given(damaged())
def test_a_damaged_file_is_read_or_refused(tmp_path, file):
    check_file(tmp_path, *file)


@long
@given(damaged())
def test_many_damaged_files_are_read_or_refused(tmp_path, file):
    check_file(tmp_path, *file)


@short
@given(triangles())
def test_any_triangles_are_a_source_or_refused(mesh):
    check_mesh(*map(np.array, mesh))


@long
@given(triangles())
def test_many_triangles_are_a_source_or_refused(mesh):
    check_mesh(*map(np.array, mesh))


@short
@given(triangles())
def test_what_is_written_is_what_is_read(tmp_path, mesh):
    points, faces = (np.array(part) for part in mesh)
    for suffix in ("obj", "off", "ply"):
        (tmp_path / f"a.{suffix}").write_bytes(WRITERS[suffix](*mesh))
        read = answered(lambda suffix=suffix: ck.read_mesh(tmp_path / f"a.{suffix}"))
        if isinstance(read, tuple):
            np.testing.assert_array_equal(read[0][read[1]], points[faces])


@pytest.mark.parametrize("file", corpus(".obj", ".ply", ".stl", ".off"), ids=lambda file: file.name)
def test_what_broke_once_is_read_or_refused(tmp_path, file):
    check_file(tmp_path, file.suffix[1:], file.read_bytes())
