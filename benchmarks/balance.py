"""What balancing the fluxes is worth on real meshes, by the degree of the polynomials, and what it costs.

Run ``CPMKIT_DATA=folder python benchmarks/balance.py``; it needs ``pip install . ./plugins/*`` and the meshes
fish.obj, koala.obj, nefertiti-lowres.obj and spot.obj in that folder. It prints the table of docs/tables/balance.md:
the difference between the closest point method and linear finite elements for -Lap u + u = f, in boxes of side 1, root
mean square over several positions of the grid. Cost is the processor's time for a solve with degree 5 beside one
without, median of rounds that take turns.
"""

from __future__ import annotations

import sys
from time import process_time

import numpy as np
from unfolding import positions, solution_off

import cpmkit as ck

SPACINGS = {"fish": 0.0156, "koala": 0.0167, "nefertiti": 0.0177, "spot": 0.0193}
DEGREES = (1, 2, 3, 4, 5, 6, 8)
ROUNDS = 5


def differences(name: str, spacing: float, count: int) -> np.ndarray:
    """Return the differences (count, degrees) from finite elements, that without balance first."""
    scene, options, measure = solution_off(name)
    found = []
    for origin in positions(spacing, count):
        solution = ck.solve(scene, spacing, origin=origin, **options)
        balanced = [ck.solve(scene, spacing, origin=origin, balance=degree, **options) for degree in DEGREES]
        found.append([measure(one) for one in (solution, *balanced)])
    return np.array(found)


def cost(name: str, spacing: float) -> float:
    """Return how much longer a solve with balanced fluxes takes than one without."""
    scene, options, _ = solution_off(name)
    spent: dict[int, list[float]] = {0: [], 5: []}
    for _ in range(ROUNDS):
        for degree, seconds in spent.items():
            start = process_time()
            ck.solve(scene, spacing, balance=degree, **options)
            seconds.append(process_time() - start)
    return float(np.median(spent[5]) / np.median(spent[0]))


def main(count: int = 5) -> None:
    print(f"| mesh | spacing | without | {' | '.join(f'degree {degree}' for degree in DEGREES)} | cost of degree 5 |")
    print("|---|--:|" + "--:|" * (len(DEGREES) + 2))
    for name, coarse in SPACINGS.items():
        for spacing in (coarse, round(coarse / 2, 5)):
            rms = np.sqrt((differences(name, spacing, count) ** 2).mean(axis=0))
            cells = [f"{value:.2f}" for value in rms]
            print(f"| {name} | {spacing} | {' | '.join(cells)} | {cost(name, spacing):.2f} |", flush=True)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
