"""No public call changes the tables that all calls share: their bytes are the same before and after."""

import hashlib
from collections.abc import Mapping
from dataclasses import fields, is_dataclass

import numpy as np
import pytest
from model_problems import on_circle
from scipy.sparse import issparse

import cpmkit as ck
from cpmkit.plugin import LocalSource

CUT = ck.source("analytic.point", at=on_circle(np.array([1.0]))[0])
RING = ck.source("analytic.circle", radius=0.5)
ALWAYS = {"both": ck.Dirichlet(0.0)}


def around(x):
    """A velocity about the origin."""
    return np.stack([-x[:, 1], x[:, 0]], axis=1)


def arrays_of(thing, path):
    """Yield the name and the array of every array of a dataclass, and of what it holds; sources are left out."""
    if isinstance(thing, np.ndarray):
        yield path, thing
    elif issparse(thing):
        yield from ((f"{path}.{part}", getattr(thing, part)) for part in ("data", "indices", "indptr"))
    elif isinstance(thing, (list, tuple)):
        for number, one in enumerate(thing):
            yield from arrays_of(one, f"{path}[{number}]")
    elif is_dataclass(thing) and type(thing).__module__.startswith("cpmkit.") and not isinstance(thing, LocalSource):
        for field in fields(thing):
            if field.name not in ("source", "surface", "boundaries", "data") or "BoundaryData" in type(thing).__name__:
                yield from arrays_of(getattr(thing, field.name), f"{path}.{field.name}")


def prints_of(tables):
    """Return a hash of each array of the tables, and of the difference table, by name."""
    named = {**dict(arrays_of(tables, "tables")), **dict(arrays_of(tables.differences, "differences"))}
    return {name: hashlib.sha256(np.ascontiguousarray(one).tobytes()).hexdigest() for name, one in named.items()}


def scenes():
    """An arc that is cut at a point, and a disc in which a circle holds a value: open, with ghosts, cheap."""
    arc = ck.source("analytic.arc", start=0.3, end=2.7)
    disc = ck.source("solid", of=ck.source("analytic.circle"))
    return {"arc": (arc, CUT, [[0, 1]], 0.1), "disc": (disc, RING, [[0.1, 0.2]], 0.2)}


def scene_of(name, problem, **sides):
    surface, source, _, _ = scenes()[name]
    return ck.Scene(surface, problem, [ck.Boundary("inside", source, **(sides or ALWAYS))])


PROBLEMS: Mapping[str, ck.Equation] = {
    "poisson": ck.Poisson(1.0),
    "elliptic": ck.Elliptic(1.0, diffusivity=lambda x: 2 + x[:, 0], velocity=around, c=lambda x: x[:, 1]),
    "drift": ck.Elliptic(1.0, velocity=around),
    "helmholtz": ck.Helmholtz(1.0, 0.5),
    "heat": ck.Heat(1.0, 0.02, 0.01),
    "wave": ck.Wave(1.0, 0.02, 0.01),
    "eigen": ck.Eigen(2),
    "biharmonic": ck.Biharmonic(1.0),
}


@pytest.mark.parametrize("name", ["arc", "disc"])
def test_every_equation_leaves_the_tables_as_they_are(name):
    prepared = ck.prepare(scene_of(name, ck.Poisson(1.0)), scenes()[name][3], form="collocation", solver="direct")
    tables = prepared.discretized.tables
    before = prints_of(tables)
    assert {"tables.extension.data", "tables.neighbours", "tables.layout.band.nodes"} <= set(before)
    assert any("ghosts" in field for field in before)
    for kind, problem in PROBLEMS.items():
        solution = prepared.solve(problem=problem)
        assert np.isfinite(solution.values).all()
        assert prints_of(tables) == before, kind
    prepared.solved_by("reference").solve(problem=PROBLEMS["drift"])
    assert prints_of(tables) == before


@pytest.mark.parametrize("name", ["arc", "disc"])
def test_every_reading_leaves_the_tables_as_they_are(name, tmp_path):
    scene = scene_of(name, ck.ScreenedPoisson(1.0), left=ck.Dirichlet(0.0), right=ck.Neumann(1.0))
    _, _, points, spacing = scenes()[name]
    solution = ck.solve(scene, spacing, form="collocation")
    before, file = prints_of(solution.discretized.tables), tmp_path / "solution.npz"
    calls = {
        "evaluate": lambda: solution.evaluate(points, side="left"),
        "gradient": lambda: solution.gradient(points),
        "flux": lambda: solution.flux("inside", "left"),
        "flux through the edge": lambda: solution.flux("edge"),
        "flux_density": lambda: solution.flux_density("inside", "right", points),
        "signed_distance": lambda: solution.signed_distance("inside", points),
        "display_mesh": solution.display_mesh,
        "doubled": lambda: solution.doubled,
        "save": lambda: (solution.save(file), solution.save(tmp_path / "solution.vtp")),
        "load": lambda: ck.load(file, scene).evaluate(points),
        "explain": lambda: ck.explain(scene, spacing, form="collocation", dry_run=True),
        "repr": lambda: (repr(solution), solution.discretization(), solution.arrays()),
    }
    for call, ask in calls.items():
        ask()
        assert prints_of(solution.discretized.tables) == before, call


def test_an_estimate_leaves_the_tables_as_they_are_and_a_loaded_solution_has_the_same(tmp_path):
    scene = scene_of("arc", ck.ScreenedPoisson(1.0))
    solution = ck.estimate_error(scene, 0.05, form="collocation").solution
    solution.save(tmp_path / "solution.npz")
    assert prints_of(ck.load(tmp_path / "solution.npz", scene).discretized.tables) == prints_of(
        solution.discretized.tables
    )
    assert prints_of(ck.solve(scene, 0.05, form="collocation").discretized.tables) == prints_of(
        solution.discretized.tables
    )


@pytest.mark.parametrize("name", ["arc", "disc"])
def test_shared_matrices_are_read_only(name):
    tables = ck.solve(scene_of(name, PROBLEMS["elliptic"]), scenes()[name][3], form="collocation").discretized.tables
    matrices = (tables.extension, tables.differences)
    parts = [getattr(one, part) for one in matrices for part in ("data", "indices", "indptr")]
    for array in (tables.neighbours, *parts):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0
