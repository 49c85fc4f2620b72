"""Reading back what :meth:`Solution.save` wrote as .npz: with its scene a whole solution, without it the mesh."""

from __future__ import annotations

import json
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, NoReturn, TypeVar, overload

import numpy as np

from cpmkit.balance import Leak
from cpmkit.discretization import Discretization, discretize
from cpmkit.errors import InputError
from cpmkit.export import FORMAT
from cpmkit.flux_balance import Balance
from cpmkit.null_space import Defect
from cpmkit.protocols import SIDES, Floats, Ints
from cpmkit.scene import Scene
from cpmkit.solution import Solution
from cpmkit.solvers.report import SolveReport
from cpmkit.summary import describe_scene
from cpmkit.work import Work

Record = TypeVar("Record")


@dataclass(frozen=True, eq=False)
class SavedSolution:
    """What a .npz holds without its scene: the mesh with the values at its vertices, and the summary.

    Attributes
    ----------
    points : (v, d) float64
        Vertices of the display mesh; a vertex on a boundary appears once a side. Empty where the surface had no mesh.
    cells : (m, k) int64
        Its triangles, segments and points; shorter rows end in -1.
    values : (v, channels) float64
        The solution at the vertices.
    summary : mapping
        What was solved, what it cost and what it reached.
    arrays : mapping
        All arrays of the file, such as ``lattice_frames`` and ``lattice_frame_times`` of a problem in time.
    """

    points: Floats
    cells: Ints
    values: Floats
    summary: Mapping[str, Any]
    arrays: Mapping[str, Any]

    def evaluate(self, *_points: Any, **_side: Any) -> NoReturn:
        """Raise: without its scene a solution is known at the mesh's vertices only."""
        raise InputError("A solution loaded without its scene cannot be evaluated; give scene= to cpmkit.load.")


@overload
def load(path: str | Path) -> SavedSolution: ...
@overload
def load(path: str | Path, scene: Scene | str | Path) -> Solution: ...
def load(path: str | Path, scene: Scene | str | Path | None = None) -> Solution | SavedSolution:
    """Read a solution that was saved as ``.npz``.

    Parameters
    ----------
    path : path
        Of the file.
    scene : Scene or path, optional
        The scene that was solved, or the scene file it came from. Its tables are built again, as long as that
        takes, and filled with the saved values: the solution reads as it did, to the last bit. That the scene is the
        one that was solved is checked by its nodes, its ghosts, and the names and kinds of its conditions;
        the data of conditions and right-hand sides are not saved and not compared.

    Returns
    -------
    Solution, or SavedSolution without a scene
        Of a problem in time the solution at the end, of an eigenvalue problem one channel an eigenfunction; frames and
        eigenvalues are among the arrays of the SavedSolution.

    Raises
    ------
    InputError
        If the file is missing, is not whole, was not written by cpmkit or by a later format of it, or belongs to
        another scene.

    Examples
    --------
    >>> import cpmkit as ck, tempfile
    >>> scene = ck.Scene(ck.source("analytic.circle"), ck.ScreenedPoisson(lambda x: x[:, 0]))
    >>> solution = ck.solve(scene, spacing=0.1)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     solution.save(f"{folder}/circle.npz")
    ...     again = ck.load(f"{folder}/circle.npz", scene)
    >>> bool(again.evaluate([[0.6, 0.8]]) == solution.evaluate([[0.6, 0.8]]))
    True
    """
    path = Path(path)
    arrays = _read(path)
    summary = json.loads(str(arrays["summary"]))
    if scene is None:
        return _light(arrays, summary)
    if not isinstance(scene, Scene):
        from cpmkit.scenefile import load_scene

        scene = load_scene(scene).scene
    return _rebuilt(path, arrays, summary, scene)


def _read(path: Path) -> dict[str, Any]:
    """Return all arrays of a file that cpmkit wrote."""
    if not path.is_file():
        raise InputError(f"There is no file {str(path)!r}; give the path of a solution that was saved as .npz.")
    try:
        # Opened here, for np.load leaves a file open that it finds broken.
        with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
    except (ValueError, TypeError, OSError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        raise InputError(
            f"{path.name!r} is not a whole .npz file; give one that the method save of a solution wrote."
        ) from error
    if "format" not in arrays or "summary" not in arrays:
        raise InputError(f"{path.name!r} is no solution; give a file that the method save of a solution wrote.")
    if arrays["format"] != FORMAT:
        raise InputError(
            f"{path.name!r} is of format {arrays['format']}, and this cpmkit reads format {FORMAT}; solve the "
            "scene again, or read the file with the version that its summary names."
        )
    return arrays


def _light(arrays: Mapping[str, Any], summary: Mapping[str, Any]) -> SavedSolution:
    channels = int(summary.get("discretization", {}).get("channels", 1))
    none = (np.zeros((0, 0)), np.zeros((0, 0), dtype=np.int64), np.zeros((0, channels)))
    points, cells, values = (
        arrays.get(name, empty) for name, empty in zip(("points", "cells", "values"), none, strict=True)
    )
    return SavedSolution(points, cells, values, summary, arrays)


def _rebuilt(path: Path, arrays: Mapping[str, Any], summary: Mapping[str, Any], scene: Scene) -> Solution:
    lattice = {name.removeprefix("lattice_"): array for name, array in arrays.items() if name.startswith("lattice_")}
    if "nodes" not in lattice:
        raise InputError(f"{path.name!r} holds a solution of another back end than 'cpm'; load it without a scene.")
    if lattice["origin"].shape != (scene.surface.dim,) or _conditions(summary["scene"]) != _conditions(
        describe_scene(scene)
    ):
        raise _of_another_scene(path)
    tables = discretize(
        scene,
        float(lattice["spacing"]),
        degree=int(lattice["degree"]),
        order=int(lattice["order"]),
        origin=lattice["origin"],
        sheets=lattice["sheets"].item() if "sheets" in lattice else True,
    )
    if not _fits(tables, lattice):
        raise _of_another_scene(path)
    balance = summary["discretization"].get("balance")
    return Solution(
        scene,
        lattice["unknowns"],
        _record(SolveReport, summary["report"]),
        _record(Work, summary["work"]),
        summary["seconds"],
        tables,
        warnings=tuple(summary["warnings"]),
        defects=tuple(_record(Defect, one) for one in summary.get("defects", ())),
        leaks=tuple(_record(Leak, one) for one in summary.get("leaks", ())),
        balance=None if balance is None else _record(Balance, balance),
    )


def _of_another_scene(path: Path) -> InputError:
    return InputError(f"{path.name!r} was saved from another scene than the one given; give the scene that was solved.")


def _conditions(scene: Mapping[str, Any]) -> Any:
    """Return the equation's kind, and the names of the boundaries with the kinds of their conditions."""
    kinds = [(one["name"], *(one[side].split()[0] for side in SIDES if side in one)) for one in scene["boundaries"]]
    return scene["problem"]["kind"], kinds


def _fits(tables: Discretization, lattice: Mapping[str, Any]) -> bool:
    band, unknowns = tables.layout.band, lattice["unknowns"]
    return bool(
        np.array_equal(band.nodes[: band.inner], lattice["nodes"])
        and np.array_equal(tables.unknowns.ghost_nodes, lattice["ghosts"])
        and len(unknowns) == tables.unknowns.count
    )


def _record(kind: type[Record], saved: Mapping[str, Any]) -> Record:
    """Return a record from its plain values; those that it does not have are left out."""
    names = {field.name for field in fields(kind)}  # type: ignore[arg-type] # all kinds are dataclasses
    values = {name: value for name, value in saved.items() if name in names}
    return kind(**{name: tuple(value) if isinstance(value, list) else value for name, value in values.items()})
