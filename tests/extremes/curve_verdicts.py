"""What is wrong with a bare curve's samples and its solution, and whether that was warned of."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from extremes.bare_curves import ORIGINS
from extremes.curve_arcs import graph_counts

import cpmkit as ck

#: The sum of the weights may be off by this share of the length.
MOST_LENGTH_ERROR = 0.02
#: u may be off by this share of its range (root mean square), and by so many times the best of all origins.
MOST_U_ERROR, TIMES_BEST = 0.01, 4.0


@dataclass(frozen=True)
class Verdict:
    """Of one lattice: the case, what is wrong in words, "" for nothing, and what was warned of."""

    name: str
    wrong: str
    warnings: tuple[str, ...]

    @property
    def is_silent(self):
        """Whether it is wrong and nobody says so."""
        return bool(self.wrong) and not self.warnings


def geometry_verdict(case, number):
    """Return what is wrong with the samples on the lattice with the origin of that number."""
    scene, name = ck.Scene(case.curve, ck.ScreenedPoisson(_load(case.curve))), f"{case.name}, {ORIGINS[number]} origin"
    try:
        sampled = ck.discretize(scene, case.spacing, form="galerkin", origin=case.origins[number]).sampled
    except ck.CpmkitError as error:
        return Verdict(name, f"refused: {error}", (str(error),))
    counts, length = graph_counts(sampled.mesh.cells), sampled.samples.weights.sum()
    wrong = "" if counts == case.curve.truth else f"ends, components, loops {counts} for {case.curve.truth}"
    if abs(length / case.curve.length - 1) > MOST_LENGTH_ERROR:
        wrong += f" length {length:.4g} for {case.curve.length:.4g}"
    return Verdict(name, wrong, sampled.warnings)


def verdicts(case):
    """Return what is wrong on each of the three lattices, in samples and solution."""
    found = [geometry_verdict(case, number) for number in range(len(ORIGINS))]
    points, exact, weights = case.curve.screened(_load(case.curve))
    errors = np.full(len(ORIGINS), np.inf)
    for number, origin in enumerate(case.origins):
        if not found[number].wrong.startswith("refused"):
            problem = ck.ScreenedPoisson(_load(case.curve))
            u = ck.solve(
                ck.Scene(case.curve, problem), spacing=case.spacing, origin=origin, form="galerkin", progress=False
            )
            square = weights @ (u.evaluate(points) - exact) ** 2 / weights.sum()
            errors[number] = np.sqrt(square) / np.ptp(exact)
    limit = max(MOST_U_ERROR, TIMES_BEST * errors.min())
    return [
        Verdict(one.name, one.wrong + (f" u off by {error:.2%}" if limit < error < np.inf else ""), one.warnings)
        for one, error in zip(found, errors, strict=True)
    ]


def _load(curve):
    """Return f, a wave that is as long as the curve's size."""
    way = 2 * np.pi / curve.size * np.array([0.6, 0.5, 0.4])[: curve.dim]
    return lambda x: np.cos(x @ way + 0.3)
