"""Every scene of examples/ and every problem of the documentation's tables, in both forms.

Run ``python benchmarks/both_forms.py``, or with the names of some of ``scenes``, ``studies``, ``finest``, ``meshes``,
``finest_meshes``, ``cuts``, ``representations`` and ``eigenvalues``; it needs ``pip install . ./plugins/*`` and, for
real meshes, ``CPMKIT_DATA`` set to their folder; what is missing is left out, and said. It prints
tables/both-forms.md: the largest and the root mean square error in percent of the solution's range, each the root
mean square over positions of the lattice, and what share of it the Galerkin form leaves. Where that is more than a
tenth above one, the reason stands beside.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import problems_of_documentation as documentation
from problems_of_documentation import WAYS, Problem

import cpmkit as ck
from cpmkit.errors import CpmkitError
from cpmkit.grid.lattice import lattice_of
from cpmkit.studies.tables import table_row, table_rule

FORMS = ("collocation", "galerkin")
#: Errors that differ by less than a tenth are equal: positions of the lattice move them by more.
WORSE = 1.1
#: Errors below this share of the range, in percent, are those of rounding and of the solver.
SOLVED = 1e-7
#: Why the Galerkin form is behind, by the beginning of a title.
REASONS: dict[str, str] = {}


@dataclass(frozen=True)
class Errors:
    """Of one form, in percent: the largest and the root mean square, over positions; or why there is none."""

    largest: float
    rms: float
    refused: str = ""


def errors_of(problem: Problem, form: str) -> Errors:
    """Solve at every position."""
    dim = problem.scene.surface.dim
    start = lattice_of(problem.scene.surface, problem.spacing).origin
    found = []
    for k in range(problem.positions):
        shift = problem.spacing * np.random.default_rng(k).uniform(0, 1, dim)
        options = {**problem.options, "origin": start + shift, "form": form}
        try:
            off = problem.off(ck.solve(problem.scene, problem.spacing, **options))
        except CpmkitError as error:
            return Errors(np.nan, np.nan, f"{type(error).__name__}: {error}")
        found.append((np.abs(off).max(), np.sqrt(np.mean(np.square(off)))))
    largest, rms = 100 * np.sqrt(np.mean(np.square(found), axis=0))
    return Errors(float(largest), float(rms))


def share(collocation: float, galerkin: float) -> float:
    """Return what share of the error the Galerkin form leaves; none is left where both are rounding."""
    return galerkin / collocation if max(galerkin, collocation) > SOLVED else 0.0


def cells(problem: Problem, found: Sequence[Errors]) -> Iterator[str]:
    """Yield the cells of a row."""
    yield from (problem.title, f"{problem.spacing:g}", problem.against)
    worse = False
    for name in ("largest", "rms"):
        pair = [getattr(one, name) for one in found]
        left = share(*pair)
        worse = worse or left > WORSE
        yield from (*("" if np.isnan(one) else f"{one:.2g}" for one in pair), "" if np.isnan(left) else f"{left:.3f}")
    refused = next((one.refused for one in found if one.refused), "")
    reason = next((why for start, why in REASONS.items() if problem.title.startswith(start)), "not known")
    yield refused or (reason if worse else "")


def main(names: Sequence[str] = WAYS) -> None:
    """Print the table."""
    heads = ["problem", "spacing", "measured against"]
    heads += [
        f"{error} %, {form}" for error in ("largest", "rms") for form in ("collocation", "Galerkin", "share left")
    ]
    print(table_row([*heads, "why more is left"]), table_rule(1, len(heads)), sep="\n", flush=True)
    for name in names:
        for problem in getattr(documentation, name)():
            found = [errors_of(problem, form) for form in FORMS]
            print(table_row(list(cells(problem, found))), flush=True)


if __name__ == "__main__":
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ck.CpmkitWarning)
        main(sys.argv[1:] or WAYS)
