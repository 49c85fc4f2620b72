"""Solutions read from .npz files: whole solutions if the scene is given, else the mesh with values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NoReturn, overload

import numpy as np

from cpmkit.errors import InputError, shown
from cpmkit.facade import Solution
from cpmkit.files.plain_values import record_from_table
from cpmkit.forms.choice import RENAMED_OPTIONS, module_of, options_of
from cpmkit.forms.contract import Discretized
from cpmkit.forms.data_checks import Imbalance
from cpmkit.linear.residuals import SolveReport
from cpmkit.saving.saved_solutions import check_same_scene, other_scene_error, read_solution
from cpmkit.scene.scene import Scene
from cpmkit.types import Floats, Ints


@dataclass(frozen=True, eq=False)
class SavedSolution:
    """A saved solution without its scene: the mesh with values at its vertices, and the summary."""

    #: (v, d): vertices of the display mesh, those on a boundary once for each side. Empty if the surface had no mesh.
    points: Floats
    cells: Ints  #: (m, k): triangles, segments and points of the mesh, by vertex numbers; shorter rows end in -1.
    values: Floats  #: (v, channels): the solution at the vertices.
    summary: Mapping[str, Any]  #: The problem, its cost and its result.
    #: The arrays of the file, such as ``lattice_frames`` and ``lattice_frame_times`` of a problem in time.
    arrays: Mapping[str, Any]

    def evaluate(self, *_points: Any, **_side: Any) -> NoReturn:
        """Raise InputError: a solution without its scene is known only at the vertices of the mesh."""
        raise InputError("A solution loaded without its scene cannot be evaluated; give scene= to cpmkit.load.")


@overload
def load(path: str | Path) -> SavedSolution: ...
@overload
def load(path: str | Path, scene: Scene | str | Path) -> Solution: ...
def load(path: str | Path, scene: Scene | str | Path | None = None) -> Solution | SavedSolution:
    """Return a solution that was saved as ``.npz``.

    Parameters
    ----------
    path : path
        The file.
    scene : Scene or path, optional
        The scene that was solved, or its scene file. It is discretised again and filled with the saved values: the
        solution evaluates as before, to the last bit. The scene is compared with the saved one by its nodes, by its
        ghosts with their sides, and by its equation and conditions with their numbers, also on the edge; functions are
        not saved and not compared.

    Returns
    -------
    Solution, or SavedSolution without a scene
        For an equation in time the solution at the end, for an eigenvalue problem one channel for each eigenfunction;
        frames and eigenvalues are among the arrays of the SavedSolution.

    Raises
    ------
    InputError
        If the file is missing, incomplete, not written by cpmkit or of a later format, has unexpected arrays, or
        belongs to another scene; others as reading or discretising the scene raises them.

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
    try:
        path = Path(path)
    except TypeError as error:
        raise InputError(f"cpmkit.load reads a file, and needs its path, got {shown(path)}.") from error
    arrays, summary = read_solution(path)
    if scene is not None and not isinstance(scene, Scene):
        from cpmkit.scenefile.scene_files import load_scene

        scene = load_scene(scene).scene
    if scene is not None:
        return _rebuild_solution(path, arrays, summary, scene)
    channels = summary["discretization"].get("channels", 1)
    none = {"points": np.zeros((0, 0)), "cells": np.zeros((0, 0), dtype=np.int64), "values": np.zeros((0, channels))}
    return SavedSolution(**{name: arrays.get(name, none[name]) for name in none}, summary=summary, arrays=arrays)


def _rebuild_solution(path: Path, arrays: Mapping[str, Any], summary: Mapping[str, Any], scene: Scene) -> Solution:
    """Return the solution with the ``arrays`` and ``summary`` of a file, on the scene discretised again.

    Raises InputError if the file is damaged, belongs to another scene, or is from a back end without a lattice.
    """
    lattice = {name.removeprefix("lattice_"): array for name, array in arrays.items() if name.startswith("lattice_")}
    if "nodes" not in lattice:
        raise InputError(
            f"{shown(path.name)} holds a solution of another back end than 'cpm'; load it without a scene."
        )
    where = f"the summary of {shown(path.name)}"
    check_same_scene(path, summary["scene"], scene)
    if lattice["origin"].shape != (scene.surface.dim,):
        raise other_scene_error(path, f"it lies in {len(lattice['origin'])} dimensions")
    spacing = lattice["spacing"]
    with np.errstate(over="ignore", invalid="ignore"):
        nodes = lattice["origin"] + spacing * lattice["nodes"]
        beyond = np.abs(nodes - np.clip(nodes, *np.asarray(scene.surface.bounds, dtype=np.float64)))
    if not (spacing > 0 and len(nodes) and np.all(beyond <= 12 * spacing)):  # before the scene is discretised
        raise other_scene_error(path, "its nodes are elsewhere")
    values = {
        RENAMED_OPTIONS.get(name, name): array.item() if array.ndim == 0 else array for name, array in lattice.items()
    }
    if values.get("balance") == 0:  # saved by a release that had this option
        del values["balance"]
    try:
        options, _ = options_of(scene, values["spacing"], values)
    except InputError as error:
        raise InputError(f"{shown(path.name)} is damaged: {error}") from error
    options = replace(options, reason=str(summary["discretization"].get("form_reason", "")))
    form: Discretized = module_of(options.form).discretize(scene, options)
    channels = getattr(scene.problem, "count", scene.channels)
    differs = form.differs_from(lattice)
    if differs or lattice["unknowns"].shape != (form.size, channels):
        raise other_scene_error(path, differs or "its nodes are others")
    return Solution(
        form,
        lattice["unknowns"],
        record_from_table(SolveReport, summary["report"], f"report in {where}"),
        record_from_table(form.traits.work_record, summary["work"], f"work in {where}"),
        summary["seconds"],
        warnings=tuple(summary["warnings"]),
        imbalances=tuple(
            record_from_table(Imbalance, table, f"an imbalance in {where}") for table in summary.get("imbalances", ())
        ),
    )
