"""Array files of any sort, wherever one is read: an answer or a CpmkitError."""

import io
import struct
import zipfile

import numpy as np
import pytest
from fuzzing import answered, corpus, long, short
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

import cpmkit as ck
from cpmkit.files.array_files import read_arrays
from cpmkit.plugin import read_array

TYPES = st.one_of(
    hnp.floating_dtypes(), hnp.integer_dtypes(), hnp.boolean_dtypes(), hnp.unicode_string_dtypes(max_len=4)
)
WORDS = st.sampled_from(
    ["{", "}", "'descr'", "'fortran_order'", "'shape'", ":", ", ", "'<f8'", "'|O'", "'<M8[s]'", "[('a', '<f8')]"]
    + [
        "(3, 3)",
        "(-1, 3)",
        "(10**9, )",
        "(9" + "9" * 20 + ", 3)",
        "(0, 3)",
        "()",
        "True",
        "False",
        "1",
        "\n ",
        "'",
        "[",
    ]
    + ["{'descr': '<f8', 'fortran_order': False, 'shape': (2, 3), }", "{'descr': '<f8', 'fortran_order': 1, "]
)
HEADERS = st.lists(WORDS, max_size=12).map("".join)


def saved(array):
    buffer = io.BytesIO()
    np.save(buffer, array, allow_pickle=False)
    return buffer.getvalue()


def headed(header, data, version):
    text = header.encode()
    length = struct.pack("<H" if version == 1 else "<I", len(text))
    return b"\x93NUMPY" + bytes([version, 0]) + length + text + data


@st.composite
def array_files(draw):
    """Return the bytes of an .npy file: a good one of any type and shape, one of a header at random, or damaged."""
    good = hnp.arrays(TYPES, hnp.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=7)).map(saved)
    odd = st.builds(headed, HEADERS, st.binary(max_size=80), st.integers(1, 4))
    data = bytearray(draw(st.one_of(good, odd, st.binary(max_size=40))))
    for place, value in draw(st.lists(st.tuples(st.integers(0, 300), st.integers(0, 255)), max_size=2)):
        if data:
            data[place % len(data)] = value
    return bytes(data[: draw(st.integers(0, len(data)))] if draw(st.booleans()) else data)


def check_npy(folder, data):
    file = folder / "a.npy"
    file.write_bytes(data)
    read = answered(lambda: read_array(file))
    if isinstance(read, np.ndarray):
        np.testing.assert_array_equal(read, np.load(file, allow_pickle=False))
    for kind, keys in (
        ("points", {}),
        ("mesh.polyline", {}),
        ("pointcloud.points", {"method": "nearest"}),
        ("levelset.grid", {"spacing": 0.5}),
    ):
        answered(lambda kind=kind, keys=keys: ck.source(kind, file=file, **keys))


def check_npz(folder, members, place, value):
    """Read an .npz file of ``members`` in which one byte was changed."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for number, data in enumerate(members):
            archive.writestr(f"a{number}.npy", data)
    data = bytearray(buffer.getvalue())
    data[place % len(data)] = value
    (folder / "a.npz").write_bytes(bytes(data))
    read = answered(lambda: read_arrays(folder / "a.npz", [f"a{k}" for k in range(3)], "an archive", lambda *_: None))
    assert isinstance(read, (dict, ck.CpmkitError))


ARCHIVES = (st.lists(array_files(), max_size=3), st.integers(0, 2000), st.integers(0, 255))


@short
@given(array_files())
def test_an_array_file_is_read_or_refused(tmp_path, data):
    check_npy(tmp_path, data)


@long
@given(array_files())
def test_many_array_files_are_read_or_refused(tmp_path, data):
    check_npy(tmp_path, data)


@short
@given(*ARCHIVES)
def test_an_archive_is_read_or_refused(tmp_path, members, place, value):
    check_npz(tmp_path, members, place, value)


@long
@given(*ARCHIVES)
def test_many_archives_are_read_or_refused(tmp_path, members, place, value):
    check_npz(tmp_path, members, place, value)


@pytest.mark.parametrize("file", corpus(".npy"), ids=lambda file: file.name)
def test_what_broke_once_is_read_or_refused(tmp_path, file):
    check_npy(tmp_path, file.read_bytes())
