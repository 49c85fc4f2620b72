"""The peak of a whole solve in the Galerkin form on the sphere, in bytes an unknown.

Run ``python benchmarks/galerkin_memory.py``, with ``--degree 3`` for splines of another degree than 2, and with
spacings if others are wanted; it needs ``pip install . ./plugins/cpmkit-analytic`` and Linux. Each spacing has a
process of its own, which first solves a small scene, so that what is imported and compiled does not count.
"""

from __future__ import annotations

import os
import subprocess
import sys

from galerkin_multigrid import ONE_THREAD

import cpmkit as ck
from cpmkit.runtime.memory import peak_growth_bytes, reset_peak_memory

#: Of 140 and 490 thousand and a million unknowns.
SPACINGS = (0.02, 0.0107, 0.0075)
WARMING_SPACING = 0.1


def solved(spacing: float, degree: int) -> ck.Solution:
    """Solve on the sphere."""
    scene = ck.Scene(ck.source("analytic.sphere"), ck.ScreenedPoisson(lambda x: x[:, 1] * x[:, 2]))
    return ck.solve(scene, spacing, form="galerkin", degree=degree, solver="multigrid")


def peak_of(spacing: float, degree: int = 2) -> tuple[int, float]:
    """Return the number of unknowns, and the peak in bytes for each, of a solve in a process of its own."""
    environment = {**os.environ, **ONE_THREAD}
    command = [sys.executable, __file__, "--here", str(spacing), str(degree)]
    said = subprocess.run(command, env=environment, check=True, capture_output=True, text=True)
    unknowns, peak = said.stdout.split()
    return int(unknowns), float(peak)


def main() -> None:
    """Print the peaks."""
    if sys.argv[1:2] == ["--here"]:
        degree = int(sys.argv[3])
        solved(WARMING_SPACING, degree)
        before = reset_peak_memory()
        unknowns = solved(float(sys.argv[2]), degree).work.unknowns
        print(unknowns, (peak_growth_bytes(before) or 0) / unknowns)
        return
    degree, given = (int(sys.argv[2]), sys.argv[3:]) if sys.argv[1:2] == ["--degree"] else (2, sys.argv[1:])
    for spacing in [float(one) for one in given] or SPACINGS:
        unknowns, peak = peak_of(spacing, degree)
        print(f"{unknowns:,} unknowns: {peak:,.0f} bytes each at the peak")


if __name__ == "__main__":
    main()
