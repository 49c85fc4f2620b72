"""What a solve on Spot costs by both forms, and by the collocation form of another checkout, in turns.

Run ``CPMKIT_DATA=folder python benchmarks/by_turns.py PYTHON``, PYTHON being the interpreter that the other checkout is
installed for with its mesh plugin, and with spot.obj in that folder. Each round has a process for each, one thread,
which solves once so that kernels are compiled and once more for the clock: processor time of the solve alone.
"""

from __future__ import annotations

import os
import subprocess
import sys
import warnings
from pathlib import Path
from time import process_time

import numpy as np

import cpmkit as ck

#: Where only one form is known, it is the collocation form, and there is no option.
OPTIONS = {"galerkin": {"form": "galerkin"}, "collocation": {"form": "collocation"}, "the other checkout": {}}
ONE_THREAD = dict.fromkeys(("CPMKIT_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
SPACING = 0.0193
ROUNDS = 5


def scene() -> ck.Scene:
    """Return the problem of galerkin_line.py, by what all checkouts have."""
    vertices, faces = ck.read_mesh(Path(os.environ["CPMKIT_DATA"]) / "spot.obj")
    vertices = (vertices - vertices.min(axis=0)) / np.ptp(vertices, axis=0).max()
    surface = ck.source("mesh.triangles", vertices=vertices, faces=faces, closest="faceted")
    return ck.Scene(surface, ck.ScreenedPoisson(c=1.0, f=lambda x: np.cos(6 * x[:, 0]) + x[:, 1] * np.sin(9 * x[:, 2])))


def here(options: dict[str, str]) -> None:
    """Print the processor time of the second solve, and where the package lies."""
    warnings.simplefilter("ignore")
    for _ in range(2):
        one, start = scene(), process_time()
        ck.solve(one, SPACING, **options)
        spent = process_time() - start
    print(spent, ck.__file__)


def main(other: str) -> None:
    """Print the medians, and shares of them."""
    spent: dict[str, list[float]] = {name: [] for name in OPTIONS}
    for _ in range(ROUNDS):
        for name, seconds in spent.items():
            python = other if name == "the other checkout" else sys.executable
            command = [python, __file__, "--here", name]
            said = subprocess.run(command, env={**os.environ, **ONE_THREAD}, check=True, capture_output=True, text=True)
            seconds.append(float(said.stdout.split()[0]))
    medians = {name: float(np.median(seconds)) for name, seconds in spent.items()}
    for name, median in medians.items():
        print(f"{name}: {median:.3f} s; galerkin takes {medians['galerkin'] / median:.3f} of it")


if __name__ == "__main__":
    if sys.argv[1:2] == ["--here"]:
        here(OPTIONS[sys.argv[2]])
    else:
        main(sys.argv[1])
