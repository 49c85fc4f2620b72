"""Saving a solution: the suffix of the file decides what is written."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cpmkit.errors import InputError, MissingDependencyError
from cpmkit.files.whole_files import written_whole
from cpmkit.meshes.display_mesh import DisplayMesh, mesh_of
from cpmkit.protocols import ClosestPointSource, Floats, HasMesh
from cpmkit.runtime.installing import to_install
from cpmkit.view.drawing import in_space, value_colours

if TYPE_CHECKING:
    from cpmkit.solution.solution import Solution

#: Of the arrays in a .npz; :func:`cpmkit.load` reads no other.
FORMAT_VERSION = 1


def save(solution: Solution, path: str | Path) -> None:
    """Write ``solution`` to ``path``, whole or not at all; a file that is there already is replaced.

    ========= ==================================================================================
    suffix    contents
    ========= ==================================================================================
    ``.vtp``  the surface's mesh, cut along the boundaries, for ParaView: triangles, lines and
              points with point data ``u`` and, where there are three channels, ``rgb``, and, where the error
              was estimated, ``error``, in the unit of u
    ``.ply``  its triangles and all its vertices, with a colour a vertex: the three channels, or
              the first in viridis
    ``.npz``  arrays ``points``, ``cells``, ``values``, ``original`` of that mesh and, where it was
              estimated, ``error``, the lattice and its unknowns under names that begin with
              ``lattice_``, and ``summary`` and ``format``; :func:`cpmkit.load` reads it
    ``.json`` the summary: what was solved, what it cost, what it reached
    ``.pvd``  the frames of a problem in time, for ParaView: an index, and one ``.vtp`` a frame in a
              folder beside it
    ========= ==================================================================================

    Raises
    ------
    InputError
        If the suffix is none of these, the surface has no mesh to write, or the file cannot be
        written.
    MissingDependencyError
        If the format needs pyvista and that is not installed.
    """
    path = Path(path)
    check_file(path, solution.scene.surface)
    if path.suffix.lower() == ".pvd":
        from cpmkit.saving.series import save_series

        return save_series(solution, path)
    with written_whole(path) as unfinished:
        _WRITERS[path.suffix.lower()](solution, unfinished)


def check_file(path: str | Path, surface: ClosestPointSource) -> None:
    """Check, before anything is solved, that a solution on ``surface`` can be saved as ``path``.

    Raises
    ------
    InputError, MissingDependencyError
        As :func:`save` does.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in (*_WRITERS, ".pvd"):
        raise InputError(f"A solution cannot be saved as {path.name!r}; accepted are {', '.join(_WRITERS)}, .pvd.")
    if suffix not in (".vtp", ".ply", ".pvd"):
        return
    mesh_of(surface)
    if suffix == ".ply" and surface.manifold_dim == 1:
        raise InputError(
            f"{path.name!r} would hold a curve, and PLY files hold no lines; accepted are .vtp, .npz, .json."
        )
    if suffix != ".ply" and find_spec("pyvista") is None:
        raise MissingDependencyError(f"{suffix} files are written by pyvista; {to_install('view')} adds it.")


def write_summary(summary: Mapping[str, Any], path: str | Path) -> None:
    """Write a mapping of plain values as JSON, whole or not at all."""
    with written_whole(Path(path)) as unfinished:
        _write_json(summary, unfinished)


def _write_json(summary: Mapping[str, Any], path: Path) -> None:
    path.write_text(json.dumps(summary, indent=2) + "\n", encoding="utf-8")


def write_vtp(mesh: DisplayMesh, path: Path, error: Floats | None = None) -> None:
    """Write a mesh with its values, and the estimated error (v, channels) of these, for ParaView."""
    data, channels = _poly_data(mesh), mesh.values.shape[1]
    data.point_data["u"] = mesh.values[:, 0] if channels == 1 else mesh.values
    if error is not None:
        data.point_data["error"] = error[:, 0] if channels == 1 else error
    if channels == 3:
        data.point_data["rgb"] = _bytes(mesh.values)
    if mesh.normals is not None:
        data.point_data.active_normals = mesh.normals
    path.write_bytes(_vtp(data))


def _vtp(data: Any) -> bytes:
    """Return the bytes of a .vtp file. VTK does not write it: on a full disk it leaves half a file and says nothing."""
    from vtkmodules.vtkIOXML import vtkXMLPolyDataWriter

    writer = vtkXMLPolyDataWriter()
    writer.SetInputData(data)
    writer.SetDataModeToBinary()
    writer.WriteToOutputStringOn()
    writer.Write()
    return str(writer.GetOutputString()).encode()


def _save_ply(solution: Solution, path: Path) -> None:
    mesh = solution.display_mesh()
    colours = mesh.values if solution.channels == 3 else value_colours(mesh.values[:, 0])[0]
    points = np.zeros(len(mesh.points), dtype=[("xyz", "<f4", 3), ("rgb", "u1", 3)])
    points["xyz"], points["rgb"] = in_space(mesh.points), _bytes(colours)
    faces = np.zeros(len(mesh.triangles), dtype=[("corners", "u1"), ("vertices", "<i4", 3)])
    faces["corners"], faces["vertices"] = 3, mesh.triangles
    path.write_bytes(_ply_header(len(points), len(faces)) + points.tobytes() + faces.tobytes())


def _ply_header(points: int, faces: int) -> bytes:
    lines = [
        *("ply", "format binary_little_endian 1.0", f"element vertex {points}"),
        *(f"property float {name}" for name in "xyz"),
        *(f"property uchar {name}" for name in ("red", "green", "blue")),
        *(f"element face {faces}", "property list uchar int vertex_indices", "end_header"),
    ]
    return "".join(f"{line}\n" for line in lines).encode()


def _save_npz(solution: Solution, path: Path) -> None:
    arrays = {f"lattice_{name}": array for name, array in solution.arrays().items()}
    arrays |= {"format": np.array(FORMAT_VERSION), "summary": np.array(json.dumps(solution.summary()))}
    if isinstance(solution.scene.surface, HasMesh):
        mesh = solution.display_mesh()
        arrays |= {name: np.array(getattr(mesh, name)) for name in ("points", "cells", "values", "original")}
        error = _known_error(solution)
        arrays |= {} if error is None else {"error": error}
    np.savez_compressed(path, **arrays)


def _known_error(solution: Solution) -> Floats | None:
    """Return the estimated error (v, channels) at the mesh's vertices; None where it was not estimated."""
    return solution.estimated.on_mesh(solution.display_mesh()) if solution.estimated else None


_WRITERS: dict[str, Callable[[Solution, Path], None]] = {
    ".vtp": lambda solution, path: write_vtp(solution.display_mesh(), path, _known_error(solution)),
    ".ply": _save_ply,
    ".npz": _save_npz,
    ".json": lambda solution, path: _write_json(solution.summary(), path),
}


def _poly_data(mesh: DisplayMesh) -> Any:
    try:
        import pyvista
    except ImportError as error:  # installed, but a library of the system is absent
        raise MissingDependencyError(f"pyvista, which writes .vtp files, does not import: {error}.") from error

    parts = {"faces": mesh.triangles, "lines": mesh.segments, "verts": mesh.dots[:, None]}
    listed: dict[str, Any] = {
        name: np.insert(part, 0, part.shape[1], axis=1).ravel() for name, part in parts.items() if len(part)
    }
    return pyvista.PolyData(in_space(mesh.points), **listed)


def _bytes(colours: Any) -> Any:
    return np.round(255 * np.clip(colours, 0, 1)).astype(np.uint8)
