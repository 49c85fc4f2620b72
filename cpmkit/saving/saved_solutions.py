"""Solutions written to files in the format of the suffix, and saved solutions, which are checked before use."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Mapping
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Unpack, cast
from xml.sax.saxutils import quoteattr

import numpy as np

from cpmkit.errors import InputError, MissingDependencyError, shown
from cpmkit.files.array_files import SavedArray, read_json_table, read_saved
from cpmkit.files.plain_values import ANYTHING, TEXT, ValueKind, check_fields, list_of, numbers, table_of, whole_numbers
from cpmkit.files.whole_files import explain_system_error, remove_leftovers, unfinished_name, write_png, written_whole
from cpmkit.forms.choice import RENAMED_OPTIONS, every_option
from cpmkit.manifold.abilities import HasMesh
from cpmkit.manifold.source import ClosestPointSource
from cpmkit.mesh.mixed_cells import mesh_method
from cpmkit.runtime.messages import install_command
from cpmkit.runtime.options import check_one_of
from cpmkit.saving.mesh_files import MESH_WRITERS, own_mesh, write_vtp
from cpmkit.scene.scene import Scene
from cpmkit.scenefile.look import VERTICES, Look, SavingKeywords
from cpmkit.solution.display_mesh import given_mesh_of
from cpmkit.solution.frames import EvolvedRecord, frames_of
from cpmkit.solution.record import SolutionRecord
from cpmkit.solution.summary import describe_scene
from cpmkit.types import SIDES, Floats
from cpmkit.view.pictures import animate, check_film, check_look, frame_images

SAVED_SOLUTION_WORDS = "a solution that was saved as .npz"
#: The version of the format.
FORMAT_ARRAY = SavedArray("format", "i")
#: Arrays of every solution: the display mesh, and the values of some families of equations; others are not read.
MESH_ARRAYS = (
    FORMAT_ARRAY,
    SavedArray("summary", "U"),
    SavedArray("points", "f", ("vertices", "dim"), needed=False),
    SavedArray("cells", "i", ("cells", "corners"), needed=False),
    SavedArray("values", "f", ("vertices", "channels"), needed=False),
    SavedArray("original", "i", needed=False),
    SavedArray("lattice_time", "f", needed=False),
    SavedArray("lattice_frame_times", "f", ("frames",), needed=False),
    SavedArray("lattice_frames", "f", ("frames", "unknowns", "channels"), needed=False),
    SavedArray("lattice_eigenvalues", "f", ("channels",), needed=False),
    SavedArray("lattice_laplacian", "f", ("unknowns", "channels"), needed=False),
)
#: Arrays of the lattice, if there is one.
LATTICE_ARRAYS = (
    SavedArray("lattice_spacing", "f"),
    SavedArray("lattice_origin", "f", ("dim",)),
    SavedArray("lattice_nodes", "i", ("inner", "dim")),
    SavedArray("lattice_ghosts", "i", ("ghosts", 2), needed=False),
    SavedArray("lattice_left", "b", ("ghosts",), needed=False),
    SavedArray("lattice_parted_cells", "i", ("parted", "level_and_cell"), needed=False),
    SavedArray("lattice_sides", "f", ("boundaries", "dim", "moments"), needed=False),
    SavedArray("lattice_unknowns", "f", ("unknowns", "channels")),
)
#: The kind of any table.
ANY_TABLE = table_of(ANYTHING)
#: Version of the arrays in a .npz; :func:`cpmkit.load` reads no other.
FORMAT_VERSION = 1
#: Suffixes of pictures, which are not saved but drawn.
PICTURES = (".png", ".jpg", ".jpeg", ".svg", ".pdf")
#: Suffixes of films, of interactive pages, and all accepted suffixes.
FILMS, PAGE = (".gif", ".mp4"), ".html"
SUFFIXES = (*MESH_WRITERS, ".json", ".pvd", *FILMS, PAGE)


def _is_boundary(table: Any) -> bool:
    """Return True if ``table`` describes a boundary of a saved scene: a table of texts, none empty, with a name."""
    texts = ANY_TABLE.accepts(table) and "name" in table
    return texts and all(isinstance(text, str) and text for text in table.values())


#: Kinds of the keys of the summary of a solution on a lattice, and of its scene.
REBUILT_KEYS = {
    "scene": ANY_TABLE,
    "report": ANY_TABLE,
    "work": ANY_TABLE,
    "seconds": table_of(numbers(0)),
    "warnings": list_of(TEXT),
}
SCENE_KEYS = {
    "problem": ValueKind(
        "a table with a kind", lambda table: ANY_TABLE.accepts(table) and TEXT.accepts(table.get("kind"))
    ),
    "boundaries": list_of(ValueKind("a table with a name and its conditions", _is_boundary)),
}


def read_solution(path: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the arrays, by name, and the summary of a solution saved as .npz, with all arrays of the lattice or none.

    Raises InputError if there is no such file, it is of another format, or an array or the summary is damaged.
    """
    try:
        exists = path.is_file()
    except OSError:  # too long a name
        exists = False
    if not exists:
        raise InputError(f"There is no file {shown(str(path))}; give the path of a solution that was saved as .npz.")
    saved = int(read_saved(path, (FORMAT_ARRAY,), SAVED_SOLUTION_WORDS)["format"])
    if saved != FORMAT_VERSION:
        raise InputError(
            f"{shown(path.name)} is of format {saved}, and this cpmkit reads format {FORMAT_VERSION}; solve the "
            "scene again, or read the file with the version that its summary names."
        )
    options = [SavedArray(f"lattice_{name}", "bifU", needed=False) for name in (*every_option(), *RENAMED_OPTIONS)]
    rows = {row.name: row for row in (*options, *LATTICE_ARRAYS)}
    numbers_of_lattice = [replace(row, needed=False) for row in rows.values() if not row.shape]
    on_lattice = bool(read_saved(path, numbers_of_lattice, SAVED_SOLUTION_WORDS))
    arrays = read_saved(path, (*MESH_ARRAYS, *(rows.values() if on_lattice else ())), SAVED_SOLUTION_WORDS)
    mesh = [arrays[name] for name in ("points", "values", "cells") if name in arrays]
    if mesh and (len(mesh) < 3 or np.any((mesh[-1] < -1) | (mesh[-1] >= len(mesh[0])))):
        raise InputError(f"{shown(path.name)} holds half a mesh: points, cells and values belong together.")
    summary = read_json_table(arrays["summary"], path, "summary")
    where = f"the summary of {shown(path.name)}"
    check_fields(summary, {"discretization": ANY_TABLE}, where)
    channels = {"channels": whole_numbers(1, 1_000_000)}
    check_fields(summary["discretization"], {}, f"discretization in {where}", channels)
    if on_lattice:
        check_fields(summary, REBUILT_KEYS, where, {"imbalances": list_of(ANY_TABLE)})
        check_fields(summary["scene"], SCENE_KEYS, f"scene in {where}")
    return arrays, summary


def other_scene_error(path: Path, differs: str) -> InputError:
    """Return the error about a file that was saved from another scene; ``differs`` describes the difference."""
    return InputError(
        f"{shown(path.name)} was saved from another scene than the one given: {differs}; give the one that was solved."
    )


def check_same_scene(path: Path, saved: Mapping[str, Any], scene: Scene) -> None:
    """Check that a scene's equation, boundaries and edge are those ``saved``, as far as they are plain values.

    Older files have no edge: then only the kinds of equation and conditions, and the boundaries' names, are compared.
    Raises InputError with the first difference.
    """
    described = json.loads(json.dumps(describe_scene(scene)))
    if "edge" not in saved:
        saved, described = _scene_kinds(saved), _scene_kinds(described)
    for key in ("problem", "boundaries", "edge", "junctions"):
        if key in saved and saved.get(key) != described.get(key):
            raise other_scene_error(path, f"its {_difference_text(key, saved[key], described[key])}")


def _difference_text(place: str, saved: Any, described: Any) -> str:
    """Return a message on the first entry in which two unequal JSON values differ: its path, and both its values.

    ``place`` is the path, in words, of ``saved`` and ``described`` themselves.
    """
    if type(saved) is type(described) is dict and saved.keys() == described.keys():
        key = next(key for key in saved if saved[key] != described[key])
        return _difference_text(f"{place}, {key}", saved[key], described[key])
    if type(saved) is type(described) is list and len(saved) == len(described):
        number = next(number for number, pair in enumerate(zip(saved, described, strict=True)) if pair[0] != pair[1])
        return _difference_text(f"{place}, number {number + 1}", saved[number], described[number])
    return f"{place}: {shown(saved)}, and here it is {shown(described)}"


def _scene_kinds(scene: Mapping[str, Any]) -> dict[str, Any]:
    """Return the equation's kind, and lists [name, kinds of left and right condition] of boundaries, of a scene."""
    kinds = [
        [boundary["name"], *(boundary[side].split()[0] for side in SIDES if side in boundary)]
        for boundary in scene["boundaries"]
    ]
    return {"problem": scene["problem"]["kind"], "boundaries": kinds}


def save(
    solution: SolutionRecord, path: str | Path, vertices: str = "display", **options: Unpack[SavingKeywords]
) -> None:
    """Write ``solution`` to ``path``, whole or not at all; an existing file is replaced.

    ========= ==================================================================================
    suffix    contents
    ========= ==================================================================================
    ``.vtp``  the mesh for ParaView: triangles, lines and points with point data ``u`` and, where there are
              three channels, ``rgb``, and, where the error was estimated, ``error``, in the unit of u
    ``.vtu``  the same as an unstructured grid
    ``.ply``  its triangles and all its vertices, with properties ``u`` (of several channels ``u0``, ``u1``, ...) and,
              where estimated, ``error``, and a colour per vertex: the three channels, or the first in viridis
    ``.obj``  its vertices, each with a colour, triangles and lines
    ``.csv``  a line of names, then one line per vertex: ``x,y,z,u``, in the plane ``x,y,u``, and ``error`` as above
    ``.npz``  arrays ``points``, ``cells``, ``values``, ``original`` of that mesh and, where it was
              estimated, ``error``, the lattice and its unknowns under names that begin with
              ``lattice_``, and ``summary`` and ``format``; :func:`cpmkit.load` reads it
    ``.json`` the summary: the problem, its cost and its result
    ``.html`` one page that shows the solution in any browser, to be turned and zoomed
    ``.pvd``  the frames of a problem in time, for ParaView: an index, and one ``.vtp`` per frame in a
              folder beside it
    ``.gif``  the frames as a film; ``.mp4`` too
    ========= ==================================================================================

    Parameters
    ----------
    solution : Solution
    path : path
    vertices : "display" or "own"
        The mesh to write: that of pictures, as fine as the lattice and cut along the boundaries, or the mesh from which
        the surface was made, with its vertices in their order; see :meth:`Solution.at_vertices`. Then no file has
        ``error``, and ``.npz`` only ``points``, ``cells``, ``values``. Formats from ``.json`` on ignore it.
    **options
        Options of ``.html``, ``.gif`` and ``.mp4``: those of :class:`~cpmkit.scenefile.look.Look`.

    Raises
    ------
    InputError
        If the suffix or an option is not accepted, the surface has no mesh (of curves for ``.ply``), the solution no
        frames for a film or ``.pvd``, or the file cannot be written.
    MissingDependencyError
        If the format needs pyvista, imageio or matplotlib, which draws colours, and that is not installed.
    """
    path = Path(path)
    check_file(path, solution.scene.surface, vertices)
    suffix = path.suffix.lower()
    if options and suffix not in (*FILMS, PAGE):
        raise InputError(f"{', '.join(options)} are options of films and pages, and {path.name!r} is neither.")
    if suffix == ".pvd":
        return save_frames(solution, path)
    if suffix == ".json":
        return write_summary(solution.summary(), path)
    if suffix in FILMS:
        animate(solution, path, **options)
        return
    with written_whole(path) as unfinished:
        if suffix == PAGE:
            from cpmkit.view.showing import page_of

            of_page: Any = options  # page_of refuses options that pages do not have, such as fps
            unfinished.write_text(page_of(solution, **of_page), encoding="utf-8")
        elif vertices == "own":
            MESH_WRITERS[suffix](own_mesh(solution), unfinished, None)
        elif suffix == ".npz":
            _save_npz(solution, unfinished)
        else:
            MESH_WRITERS[suffix](solution.display_mesh(), unfinished, _known_error(solution))


def check_file(path: str | Path, surface: ClosestPointSource, vertices: str = "display") -> None:
    """Check before anything is solved that solutions on ``surface`` can be saved in the format of ``path``.

    ``vertices`` is as for :func:`save`. Raises InputError if the suffix or ``vertices`` is not accepted, or the surface
    has no mesh for it; MissingDependencyError if a package that the format needs for all solutions is not installed.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    check_one_of(vertices, VERTICES, "vertices")
    if suffix not in SUFFIXES:
        picture = " solution.picture(path) draws a .png;" if suffix in PICTURES else ""
        raise InputError(f"A solution cannot be saved as {path.name!r};{picture} accepted are {', '.join(SUFFIXES)}.")
    if suffix == ".json" or (suffix == ".npz" and vertices == "display"):
        return
    if suffix in MESH_WRITERS and vertices == "own":
        given_mesh_of(surface)
    else:
        mesh_method(surface)
    if suffix == ".ply" and surface.manifold_dim == 1:
        raise InputError(
            f"{path.name!r} would hold a curve, and PLY files hold no lines; accepted are .vtp, .obj, .csv, .npz."
        )
    if suffix in (".vtp", ".vtu", ".pvd") and find_spec("pyvista") is None:
        raise MissingDependencyError(f"{suffix} files are written by pyvista; {install_command('view')} adds it.")
    if suffix in (*FILMS, PAGE):
        check_look(Look())
    if suffix in FILMS:
        check_film(path)


def write_summary(summary: Mapping[str, Any], path: str | Path) -> None:
    """Write the summary of a solution, plain values, as indented JSON; raise InputError if it cannot be written."""
    with written_whole(Path(path)) as unfinished:
        unfinished.write_text(json.dumps(summary, indent=2) + "\n", encoding="utf-8")


def _save_npz(solution: SolutionRecord, path: Path) -> None:
    """Write the .npz file ``path``: lattice and unknowns, summary and, if there is a mesh, the display mesh."""
    arrays = {f"lattice_{name}": array for name, array in solution.arrays().items()}
    arrays |= {"format": np.array(FORMAT_VERSION), "summary": np.array(json.dumps(solution.summary()))}
    if isinstance(solution.scene.surface, HasMesh):
        mesh = solution.display_mesh()
        arrays |= {name: np.array(getattr(mesh, name)) for name in ("points", "cells", "values", "original")}
        error = _known_error(solution)
        arrays |= {} if error is None else {"error": error}
    np.savez_compressed(path, **arrays)


def _known_error(solution: SolutionRecord) -> Floats | None:
    """Return the estimated error (v, channels) at the display mesh's vertices; None if it was not estimated."""
    return solution.estimated.on_mesh(solution.display_mesh()) if solution.estimated else None


def save_frames(solution: SolutionRecord, path: Path) -> None:
    """Write the frames of a problem in time: a .pvd index ``path``, and .vtp files in ``<name>_frames`` beside it.

    All frames are written before the first one is moved to its place, and the index after that; surplus frames of an
    earlier series are removed last, so that all files of an index exist. Raises InputError if the solution has no
    frames, or a file cannot be written.
    """
    frames, evolved = frames_of(solution, path.name), cast("EvolvedRecord", solution)
    folder = frames_folder(path)
    unfinished = unfinished_name(folder)
    names = [_numbered_path(Path("frame.vtp"), number, len(frames)).name for number in range(len(frames))]
    try:
        with explain_system_error(f"{folder} cannot be written"):
            remove_leftovers(folder)
            unfinished.mkdir()
            for name, mesh in zip(names, evolved.frame_meshes(), strict=True):
                write_vtp(mesh, unfinished / name)
            folder.mkdir(exist_ok=True)
            for name in names:
                os.replace(unfinished / name, folder / name)
    finally:
        shutil.rmtree(unfinished, ignore_errors=True)
    with written_whole(path) as index:
        entries = [
            f'    <DataSet timestep="{frame.time!r}" part="0" file={quoteattr(f"{folder.name}/{name}")}/>'
            for frame, name in zip(frames, names, strict=True)
        ]
        lines = ['<?xml version="1.0"?>', '<VTKFile type="Collection" version="0.1">', "  <Collection>", *entries]
        text = "\n".join([*lines, "  </Collection>", "</VTKFile>", ""])
        index.write_text(text, encoding="utf-8", errors="surrogateescape")
    with explain_system_error(f"{folder} cannot be written"):
        for stale in {file.name for file in folder.glob("frame-*.vtp")} - {*names}:
            (folder / stale).unlink(missing_ok=True)  # another thread may have removed it


def frames_folder(path: Path) -> Path:
    """Return the folder ``<name>_frames`` of the frames beside their .pvd index ``path``."""
    return path.with_name(path.stem + "_frames")


def draw_frames(solution: SolutionRecord, path: Path, look: Look) -> list[Path]:
    """Draw the frames of a problem in time into ``<name>-0000.png``, ... beside ``path``, and return their paths.

    The pictures have a common colour bar. Raises InputError if the solution has no frames.
    """
    count = len(frames_of(solution, "a picture of each frame"))
    files = [_numbered_path(path, number, count) for number in range(count)]
    for file, image in zip(files, frame_images(solution, look), strict=True):
        write_png(file, image / 255)
    return files


def _numbered_path(path: Path, number: int, count: int) -> Path:
    """Return ``path`` with a hyphen and ``number`` before its suffix, in the digits of ``count`` - 1, at least four."""
    digits = max(4, len(str(count - 1)))
    return path.with_name(f"{path.stem}-{number:0{digits}}{path.suffix}")
