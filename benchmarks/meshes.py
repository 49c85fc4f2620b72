"""The Galerkin form on real meshes, against its own solution on a fifth of the spacing, and finite elements likewise.

Run ``python benchmarks/meshes.py``; it needs ``pip install . ./plugins/*`` and ``CPMKIT_DATA`` set to a folder with
fish.obj, koala.obj, nefertiti-lowres.obj, spot.obj and mountain.obj. It prints tables/forms-meshes.md: root mean
squares over vertices in percent of the solution's range, of the Galerkin form over two positions of the grid.
Linear finite elements have flat triangles, where the Galerkin form has the smooth surface that the mesh is read as: a
difference between the two that is larger than the latter's error is of that kind, or theirs.
"""

from __future__ import annotations

import warnings

import numpy as np
from forms import PROBLEMS, problems

import cpmkit as ck
from cpmkit.studies.tables import table_row, table_rule

#: The solution that errors are measured against has so many times as fine a spacing.
FINER = 5
POSITIONS, VERTICES = 2, 6000


def main() -> None:
    """Print the table."""
    warnings.simplefilter("ignore", ck.CpmkitWarning)
    heads = [
        "mesh",
        "spacing",
        "unknowns",
        "rms error %, Galerkin",
        "of half the spacing",
        "rms error %, finite elements",
    ]
    print(table_row(heads), table_rule(1, len(heads) - 1), sep="\n", flush=True)
    for study, spacing in problems():
        if study.name.startswith("sheets-") and study.name in PROBLEMS:
            scene = study.scene
            at = np.random.default_rng(0).permutation(scene.surface.mesh(1.0)[0])[:VERTICES]
            exact = ck.solve(scene, spacing / FINER, form="galerkin").evaluate(at)
            origins = [np.random.default_rng(k).uniform(0, spacing, 3) for k in range(POSITIONS)]
            coarse = [ck.solve(scene, spacing, form="galerkin", origin=origin) for origin in origins]
            half = ck.solve(scene, spacing / 2, form="galerkin")
            elements = ck.solve(scene, spacing, backend="fem")
            found = [[one.evaluate(at) - exact for one in each] for each in (coarse, [half], [elements])]
            errors = [100 * np.sqrt(np.mean(np.square(each))) / np.ptp(exact) for each in found]
            cells = [study.title, f"{spacing:g}", f"{coarse[0].work.unknowns:,}", *(f"{one:.2g}" for one in errors)]
            print(table_row(cells), flush=True)


if __name__ == "__main__":
    main()
