"""The scenes of examples/ and the problems behind the documentation's tables, with a measure of each solution's error.

Errors are taken from the exact solution where it is known. Where it is not, from the Galerkin form at a finer spacing,
which is said beside the row: of the two forms it is the one whose own error is known on such surfaces
(tables/forms-meshes.md), and linear finite elements know flat triangles alone.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from eigenvalues import ZERO_SHARE, mesh_problems, smooth_problems

import cpmkit as ck
from cpmkit.errors import CpmkitError
from cpmkit.forms.choice import choose_form
from cpmkit.scene.scene import Scene
from cpmkit.scenefile.scene_files import load_scene
from cpmkit.studies.reference_values import compute_reference, sample_points
from cpmkit.studies.run_one import tie_step_to_spacing
from cpmkit.studies.studyfile import Study, load_study

EXAMPLES = Path(__file__).parents[1] / "examples"
STUDIES = EXAMPLES / "studies"
#: Points at which solutions are read, and vertices of meshes.
POINTS, VERTICES = 4000, 6000
#: Positions of the lattice: of curves, and of surfaces.
OF_CURVES, OF_SURFACES = 16, 2
#: Spacings of a problem whose solution is not known, over that of the solution that it is measured against.
FINER = {"scene": 2, "mesh": 4, "million": 1.5}
#: Spacings of studies on surfaces: the finest so many of ``--cheap``; on curves all.
MOST_SPACINGS = 2
#: Studies whose scenes are those of panel-b and panel-d.
SAME = ("degrees-heat", "degrees-poisson")
WAYS = ("scenes", "studies", "finest", "meshes", "finest_meshes", "cuts", "representations", "eigenvalues")


@dataclass(frozen=True, eq=False)
class Problem:
    """One scene at one spacing.

    Attributes
    ----------
    title : str
    scene : Scene
    spacing : float
    off : callable
        Errors of a solution, as shares of the exact one's range; of eigenvalues, of each.
    against : str
        What they are measured against.
    positions : int
        Of the lattice.
    options : mapping
        Of ``solve``, for both forms.
    """

    title: str
    scene: Scene
    spacing: float
    off: Callable[[Any], Any]
    against: str = "exact"
    positions: int = OF_SURFACES
    options: Mapping[str, Any] = field(default_factory=dict)


def scenes() -> Iterator[Problem]:
    """Yield the scene files of examples/ that the Galerkin form carries, against half of their spacing."""
    for path in sorted(EXAMPLES.glob("[0-9]*.toml")):
        try:
            file = load_scene(path)
        except CpmkitError as error:
            print(f"{path.name} is left out: {error}", file=sys.stderr)
            continue
        assert file.spacing is not None
        form, reason = choose_form(file.scene, file.options)
        if form != "galerkin":
            print(f"{path.name} is left out: {reason}", file=sys.stderr)
            continue
        at = sample_points(file.scene, POINTS)
        off = from_finer(file.scene, file.spacing / FINER["scene"], at)
        yield Problem(path.stem, file.scene, file.spacing, off, f"Galerkin, h/{FINER['scene']}", 1, file.options)


def from_finer(scene: Scene, spacing: float, at: Any) -> Callable[[Any], Any]:
    """Return what measures differences from the Galerkin form at a finer spacing, solved when it is first asked."""

    @cache
    def exact() -> Any:
        return ck.solve(scene, spacing, form="galerkin").evaluate(at)

    return lambda solution: (solution.evaluate(at) - exact()) / np.ptp(exact())


def studies() -> Iterator[Problem]:
    """Yield the studies whose solution is known."""
    for study in _with_solution():
        curve = study.scene.surface.manifold_dim == 1
        spacings = study.sweep.spacings if curve else _cheap(study)[-MOST_SPACINGS:]
        yield from _at_spacings(study, spacings, OF_CURVES if curve else OF_SURFACES)


def finest() -> Iterator[Problem]:
    """Yield the same studies on surfaces at the spacings that ``--cheap`` leaves out, at one position each."""
    for study in _with_solution():
        if study.scene.surface.manifold_dim > 1:
            seen = _cheap(study)[-MOST_SPACINGS:]
            yield from _at_spacings(study, [h for h in study.sweep.spacings if h < max(seen) and h not in seen], 1)


def _with_solution() -> Iterator[Study]:
    for path in sorted(STUDIES.glob("*.toml")):
        study = load_study(path)
        if study.exact.u is not None and study.name not in SAME:
            yield study


def _cheap(study: Study) -> Sequence[float]:
    return study.sweep.cheap or study.sweep.spacings


def _at_spacings(study: Study, spacings: Sequence[float], positions: int) -> Iterator[Problem]:
    truth = compute_reference(study)
    off = _from_values(truth.points, truth.values)
    for spacing in spacings:
        scene = tie_step_to_spacing(study.scene, study.sweep.step_per_spacing, spacing)
        yield Problem(study.title, scene, spacing, off, positions=positions, options=_of_both(study))


def _of_both(study: Study) -> dict[str, Any]:
    return {name: value for name, value in study.options.items() if name != "origin"}


def _from_values(at: Any, values: Any) -> Callable[[Any], Any]:
    return lambda solution: (solution.evaluate(at) - values) / np.ptp(values)


def meshes() -> Iterator[Problem]:
    """Yield the meshes of the tables on sheets and normals, against a quarter of their spacing."""
    for study, at in _of_meshes():
        first, second = _descending(study)[:2]
        off = from_finer(study.scene, first / FINER["mesh"], at)
        yield _of_mesh(study, first, first / FINER["mesh"], off, OF_SURFACES)
        yield _of_mesh(study, second, first / FINER["mesh"], off, 1)


def finest_meshes() -> Iterator[Problem]:
    """Yield them at their other spacings, of 300 thousand and a million unknowns, at one position each."""
    for study, at in _of_meshes():
        for spacing in _descending(study)[2:]:
            finer = spacing / FINER["million"]
            yield _of_mesh(study, spacing, finer, from_finer(study.scene, finer, at), 1)


def _of_meshes() -> Iterator[tuple[Study, Any]]:
    """Yield the studies on meshes whose solution is not known, each with the vertices at which it is compared."""
    for path in sorted(STUDIES.glob("*.toml")):
        study = load_study(path)
        try:
            if study.exact.u is not None or not hasattr(study.scene.surface, "mesh"):
                continue
        except CpmkitError as error:
            print(f"{path.name} is left out: {error}", file=sys.stderr)
            continue
        vertices = study.scene.surface.mesh(1.0)[0]
        yield study, np.random.default_rng(0).permutation(vertices)[:VERTICES]


def _descending(study: Study) -> list[float]:
    return sorted(study.sweep.spacings, reverse=True)


def _of_mesh(study: Study, spacing: float, finer: float, off: Callable[[Any], Any], positions: int) -> Problem:
    return Problem(
        study.title, study.scene, spacing, off, f"Galerkin, h/{spacing / finer:.2g}", positions, _of_both(study)
    )


def cuts() -> Iterator[Problem]:
    """Yield the problems of tables/backends.md at the first of their spacings, against half of it."""
    from backends import MESHES
    from backends import scenes as both_problems

    for name, (spacings, _, _) in MESHES.items():
        try:
            vertices, faces = ck.read_mesh(name)
        except CpmkitError as error:
            print(f"{name} is left out: {error}", file=sys.stderr)
            continue
        for title, scene in both_problems(vertices, faces).items():
            at = sample_points(scene, POINTS)
            spacing = max(spacings)
            off = from_finer(scene, spacing / FINER["scene"], at)
            against = f"Galerkin, h/{FINER['scene']}"
            yield Problem(f"{name.removesuffix('.obj')}, {title}", scene, spacing, off, against, OF_SURFACES)


def representations() -> Iterator[Problem]:
    """Yield the problems of tables/representations.md, at two spacings."""
    import representations as study

    for manifold in (study.sphere(), study.torus()):
        at = manifold.points()
        for name, make in manifold.makers.items():
            for title, scene in study.scenes(manifold, make()).items():
                for spacing in manifold.spacings[:2]:
                    off = _from_values(at, study.u(at))
                    yield Problem(f"{manifold.name} as {name}, {title}", scene, spacing, off, positions=1)


def eigenvalues() -> Iterator[Problem]:
    """Yield those of tables/eigenvalues.md: errors of each eigenvalue other than zero."""
    for make, against in ((smooth_problems, "exact"), (mesh_problems, "finite elements")):
        for name, scene, exact, spacing in make():
            title = f"eigenvalues, {name}"
            yield Problem(title, scene, spacing, _from_eigenvalues(exact), against, 1)


def _from_eigenvalues(exact: Any) -> Callable[[Any], Any]:
    counted = np.asarray(exact) > ZERO_SHARE * np.max(exact)
    return lambda solution: (solution.eigenvalues[counted] - exact[counted]) / exact[counted]


sys.path.insert(0, str(STUDIES))  # where the scripts of studies import each other from
