"""Point clouds from files and arrays: read, and checked once."""

from __future__ import annotations

import re
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from cpmkit.plugin import (
    Floats,
    InputError,
    Ints,
    MissingDependencyError,
    as_positions,
    existing_file,
    read_array,
    read_bytes,
    read_ply_points,
    shown,
)

TEXT_SUFFIXES = (".xyz", ".txt", ".csv")
CLOUD_SUFFIXES = (".ply", *TEXT_SUFFIXES, ".npy", ".pcd")


def read_points(path: str | Path) -> np.ndarray:
    """Read a file with one point in each row.

    Raise InputError if the file is missing, is of another format, or does not parse. Raise MissingDependencyError if it
    is a PCD file and Open3D is absent or cannot load.

    Parameters
    ----------
    path : str or Path
        A PLY file, of which the vertices are read; a text file (``.xyz``, ``.txt``, or ``.csv`` with commas) with two
        or more numbers a row, as many in each, of which the first three (or two) are read; a ``.npy`` file; or a PCD
        file, for which Open3D is needed.

    Returns
    -------
    points : array
        The rows (n, 2) or (n, 3); that of a ``.npy`` file, or of text with one number a row, may have another shape.
    """
    file = existing_file(path)
    suffix = file.suffix.lower()
    if suffix not in CLOUD_SUFFIXES:
        raise InputError(
            f"{shown(file.name)} is no point cloud that can be read; accepted are {', '.join(CLOUD_SUFFIXES)}."
        )
    if suffix == ".pcd":
        return _read_pcd(file)
    try:
        return _READERS.get(suffix, _read_rows)(file)
    except OSError as error:
        raise InputError(f"{shown(file.name)} cannot be read: {error.strerror or error}.") from error


def _read_npy(file: Path) -> np.ndarray:
    return read_array(file, "an array of points")


def _read_ply(file: Path) -> np.ndarray:
    """Return the vertices (n, 3) of a PLY file; raise InputError, with its name, if it does not parse."""
    try:
        return read_ply_points(read_bytes(file))
    except InputError as error:
        raise InputError(f"{shown(file.name)} does not parse as PLY: {error}") from error


def _read_rows(file: Path) -> np.ndarray:
    """Return the first three numbers, or fewer, of each row of a text file as (n, 1 to 3).

    Raise InputError, without quoting the file, if it does not parse.
    """
    lines = read_bytes(file).decode("utf-8-sig", errors="replace").splitlines()
    kind = file.suffix[1:].upper()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # of a file without rows: the shape shows it
            rows = np.loadtxt(lines, delimiter="," if kind == "CSV" else None, ndmin=2)
    except ValueError as error:
        row = re.search(r"row (\d+)", str(error))
        place = f", and row {row[1]} does not" if row else ""
        raise InputError(
            f"{shown(file.name)} does not parse as {kind}: each row must hold as many numbers, two or more{place}."
        ) from error
    return np.asarray(rows[:, :3])


_READERS = {".ply": _read_ply, ".npy": _read_npy}


def _read_pcd(file: Path) -> np.ndarray:
    """Return the points (n, 3) of a PCD file.

    Raise InputError if there are none, MissingDependencyError if Open3D is absent or cannot load.
    """
    try:
        import open3d
    except ModuleNotFoundError as error:
        raise MissingDependencyError(
            f"{file.name!r} is a PCD file, which only Open3D reads: pip install open3d, or save the cloud as PLY."
        ) from error
    except (ImportError, OSError) as error:
        raise MissingDependencyError(_loading_error(str(error))) from error
    points = np.asarray(open3d.io.read_point_cloud(str(file)).points)
    if not len(points):
        raise InputError(f"{file.name!r} does not parse as PCD, or holds no points.")
    return points


def _loading_error(message: str) -> str:
    """Return the error sentence for an installed Open3D that does not load, from the loader's ``message``."""
    if "libusb" in message:
        return (
            "Open3D is installed but cannot load the system library libusb-1.0. "
            "On Debian: apt-get install libusb-1.0-0."
        )
    return f"Open3D is installed but cannot load: {message}. Save the cloud as PLY, which needs no Open3D."


def as_cloud(points: Any, label: str = "points") -> Floats:
    """Return ``points`` as (n, 2) or (n, 3) float64 with at least one row.

    Raise InputError, which names ``label``, if they are of another shape or type, empty, not finite or too large.
    """
    try:
        array = np.asarray(points)
    except ValueError as error:
        raise InputError(f"{label} must be an array of numbers in rows of equal length.") from error
    if array.dtype.kind not in "iuf":
        raise InputError(f"{label} must be an array of numbers, got {array.dtype}.")
    if array.ndim != 2 or array.shape[1] not in (2, 3) or not len(array):
        raise InputError(f"{label} must have shape (n, 2) or (n, 3) with n > 0, got {array.shape}.")
    return as_positions(array, array.shape[1], label)


def as_normals(normals: Any, points: Floats) -> Floats:
    """Return ``normals`` as (n, d) unit vectors, one for each of ``points`` (n, d).

    Raise InputError if their shape is not that of the points, they are no numbers, or one is zero or not finite.
    """
    vectors = as_cloud(normals, "normals")
    if vectors.shape != points.shape:
        raise InputError(f"normals must have the shape of the points {points.shape}, got {vectors.shape}.")
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    zero = np.flatnonzero(length == 0.0)
    if len(zero):
        raise InputError(f"normals must not be zero: {len(zero)} of {len(vectors)} are, first row {zero[0]}.")
    return vectors / length


def distinct_point_rows(points: Floats) -> Ints:
    """Return the rows (k,) of the first sample at each distinct place, in increasing order."""
    return np.sort(np.unique(points, axis=0, return_index=True)[1])
