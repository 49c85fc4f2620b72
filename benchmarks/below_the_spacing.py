"""Geometry below the spacing: the Galerkin form with and without cuts at creases, junctions and between charts.

Run ``python benchmarks/below_the_spacing.py``, which prints and writes tables/below-the-spacing.md, or with names of
groups, of which it prints the tables alone. ``--keep FILE`` keeps true solutions and outcomes there, and what is there
is not solved again; ``--truths`` solves all but the true solutions. It needs ``pip install . ./plugins/*``, this
repository's folder ``tests`` beside it, and ``CPMKIT_DATA`` with spot, fish, koala and nefertiti-lowres. The scenes
are those of tests/extremes/small_geometry_cases.py.

Errors are root mean squares in percent of the range of the solution. Each row is the worst of four positions of the
lattice. ``before`` is the same form with nothing cut. In the names of cases h is .05 unless they say another.
"""

from __future__ import annotations

import argparse
import json
import sys
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

sys.path[:0] = [str(Path(__file__).parents[1] / "tests")]

from extremes.small_geometry import SmallScene  # noqa: E402
from extremes.small_geometry_cases import CASES, Case  # noqa: E402

import cpmkit as ck  # noqa: E402
from cpmkit.errors import CpmkitError  # noqa: E402
from cpmkit.studies.tables import table_row, table_rule  # noqa: E402

TABLE = Path(__file__).parent / "tables" / "below-the-spacing.md"
#: Shifts of the lattice, in spacings.
POSITIONS = (0.1234, 0.4934, 0.7234, 0.9334)
HEAD = (
    "case",
    "rms before, %",
    "rms after, %",
    "first eigenvalue before, %",
    "after, %",
    "effectivity",
    "iterations",
    "unknowns, + %",
)


@dataclass(frozen=True)
class Solved:
    """A solve at one position; errors are shares of the range, NaN if a solve or an estimate was refused."""

    rms: float
    eigenvalue: float = np.nan  #: Relative error of the first eigenvalue above zero.
    effectivity: float = np.nan  #: The estimate over the error.
    iterations: int = 0
    unknowns: int = 0
    messages: tuple[str, ...] = ()


@dataclass(frozen=True)
class Reached:
    """A solve to a tolerance: the true error over it, the unknowns, and how the search ended."""

    tolerance: float
    ratio: float
    unknowns: int
    status: str


class Kept:
    """Results by name in a JSON file, or in memory alone; ``fresh`` forgets all but true solutions."""

    def __init__(self, path: Path | None, fresh: bool) -> None:
        self.path = path
        self.values = json.loads(path.read_text(encoding="utf-8")) if path and path.exists() else {}
        if fresh:
            self.values = {name: value for name, value in self.values.items() if name.startswith("truth ")}

    def get(self, name: str, compute: Any) -> Any:
        """Return what ``compute()`` returned when the name was first asked for."""
        if name not in self.values:
            self.values[name] = compute()
            print(name, "" if name.startswith("truth ") else self.values[name], file=sys.stderr, flush=True)
            if self.path:
                self.path.write_text(json.dumps(self.values), encoding="utf-8")
        return self.values[name]


@contextmanager
def nothing_cut() -> Iterator[None]:
    """Solve without cuts at creases, junctions and between charts."""

    def no_facets(mesh: Any, *_: Any) -> Any:
        return np.zeros((0, mesh.manifold_dim), dtype=np.int64)

    def no_charts(mesh: Any, *_: Any) -> Any:
        return no_facets(mesh), False

    module = "cpmkit.forms.galerkin.scene_sampling"
    with patch(f"{module}.crease_facets", no_facets), patch(f"{module}.chart_facets", no_charts):
        yield


def rms_share(solution: Any, scene: SmallScene, u: Any) -> float:
    """Return the root mean square error, as a share of the range."""
    return float(np.sqrt(np.mean((solution.evaluate(scene.points) - u) ** 2)) / np.ptp(u))


def solved(scene: SmallScene, spacing: float, shift: float, truth: Any, estimate: bool) -> Solved:
    """Solve at one position, with the estimate of the error if asked for."""
    u, eigenvalue = np.array(truth[0]), truth[1]
    options: dict[str, Any] = {"solver": "multigrid", "origin": np.full(scene.points.shape[1], shift * spacing)}
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")
        try:
            solution = ck.solve(scene.scene, spacing, **options)
            rms, off, ratio = rms_share(solution, scene, u), np.nan, np.nan
            if estimate:
                ratio = solution.error.of("rms") / rms
            if eigenvalue:
                off = abs(ck.solve(scene.eigen_scene, spacing, **options).eigenvalues[1] / eigenvalue - 1)
        except CpmkitError as error:
            return Solved(np.nan, messages=(f"raised: {error}",))
    messages = tuple(sorted({str(one.message) for one in heard}))
    return Solved(rms, float(off), float(ratio), solution.report.iterations, solution.work.unknowns, messages)


def at_positions(case: Case, spacing: float, cut: bool, kept: Kept) -> list[Solved]:
    """Return the solves of a case at all positions."""

    def compute() -> list[Any]:
        scene, truth = case.make(), truth_of(case, kept)
        if cut:
            return [asdict(solved(scene, spacing, shift, truth, True)) for shift in POSITIONS]
        with nothing_cut():
            return [asdict(solved(scene, spacing, shift, truth, False)) for shift in POSITIONS]

    found = kept.get(f"{'after' if cut else 'before'} {case.name} {spacing:g}", compute)
    return [Solved(**one) for one in found]


def truth_of(case: Case, kept: Kept) -> Any:
    """Return u at the points of a case, and its first eigenvalue above zero or None."""

    def compute() -> Any:
        u, eigenvalue = case.make().truth()
        return [np.asarray(u).tolist(), eigenvalue]

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of eigenvalues that come in pairs
        return kept.get(f"truth {case.truth_name}", compute)


def worst(found: Sequence[Solved], name: str) -> float:
    """Return the largest of one value over all positions; NaN if one solve was refused."""
    return float(np.max([getattr(one, name) for one in found]))


def percent(value: float) -> str:
    """Return a share in percent with two digits, or nothing for NaN."""
    return "" if np.isnan(value) else f"{100 * value:.2g}"


def added(before: int, after: int) -> str:
    """Return the growth in percent; 0 without a decimal if there is none, and nothing if a solve was refused."""
    return "0" if before == after else f"{100 * (after / before - 1):.1f}" if before else ""


def row(case: Case, kept: Kept) -> str:
    """Return a row of the table of all cases."""
    before, after = (at_positions(case, case.spacing, cut, kept) for cut in (False, True))
    ratios = [one.effectivity for one in after]
    unknowns = [sum(one.unknowns for one in found) for found in (before, after)]
    cells = [
        case.name,
        *(percent(worst(found, "rms")) for found in (before, after)),
        *(percent(worst(found, "eigenvalue")) for found in (before, after)),
        f"{min(ratios):.2f} to {max(ratios):.2f}",
        f"{worst(after, 'iterations'):.0f}",
        added(*unknowns),
    ]
    return table_row(cells)


def order(spacings: Sequence[float], errors: Sequence[float]) -> float:
    """Return the slope of the logarithms."""
    return float(np.polyfit(np.log(spacings), np.log(errors), 1)[0])


def order_table(cases: Sequence[Case], kept: Kept) -> Iterator[str]:
    """Yield the lines of the table of observed orders, of cases with more than one spacing."""
    yield table_row(["case", "spacings", "rms before, %", "order", "rms after, %", "order"])
    yield table_rule(2, 4)
    for case in cases:
        cells = [case.name, " ".join(f"{h:g}" for h in case.spacings)]
        for cut in (False, True):
            errors = [worst(at_positions(case, h, cut, kept), "rms") for h in case.spacings]
            cells += [" ".join(map(percent, errors)), f"{order(case.spacings, errors):.2f}"]
        yield table_row(cells)


def equal_unknowns_table(cases: Sequence[Case], kept: Kept) -> Iterator[str]:
    """Yield the lines of the table of errors at equal unknowns, between solves without cuts at three spacings."""
    yield table_row(["case", "unknowns", "rms after, %", "rms before at the same unknowns, %", "ratio"])
    yield table_rule(1, 4)
    for case in cases:
        before = [at_positions(case, h, False, kept) for h in case.spacings]
        sizes = [np.log(np.mean([one.unknowns for one in found])) for found in before]
        errors = [np.log(worst(found, "rms")) for found in before]
        after = at_positions(case, case.spacing, True, kept)
        size, error = float(np.mean([one.unknowns for one in after])), worst(after, "rms")
        other = float(np.exp(np.interp(np.log(size), sizes, errors)))
        beyond = "" if sizes[0] <= np.log(size) <= sizes[-1] else " (beyond these spacings)"
        yield table_row([case.name, f"{size:,.0f}", percent(error), percent(other) + beyond, f"{error / other:.2f}"])


def reached(case: Case, tolerance: float, kept: Kept) -> Reached:
    """Solve a case to a tolerance."""

    def compute() -> Any:
        scene, truth = case.make(), np.array(truth_of(case, kept)[0])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                solution = ck.solve(scene.scene, tolerance=tolerance)
                ratio = rms_share(solution, scene, truth) / tolerance
            except CpmkitError as error:
                return asdict(Reached(tolerance, np.nan, 0, f"raised: {error}"))
        return asdict(Reached(tolerance, ratio, solution.work.unknowns, solution.solve_history.status))

    return Reached(**kept.get(f"tolerance {case.name} {tolerance:g}", compute))


def tolerance_table(cases: Sequence[Case], kept: Kept) -> Iterator[str]:
    """Yield the lines of the table of errors over tolerances; ``*`` marks those that the solution does not claim."""
    yield table_row(["case", "tolerances", "true rms / tolerance", "unknowns"])
    yield table_rule(2, 2)
    for case in cases:
        found = [reached(case, tolerance, kept) for tolerance in case.tolerances]
        ratios = [f"{one.ratio:.2f}{'' if one.status == 'reached' else '*'}" for one in found]
        sizes = [f"{one.unknowns:,}" for one in found]
        texts = [f"{tolerance:g}" for tolerance in case.tolerances]
        name = case.shared_truth or case.name  # without a spacing
        yield table_row([name, *("; ".join(column) for column in (texts, ratios, sizes))])


def lines_of(groups: Sequence[str], kept: Kept) -> Iterator[str]:
    """Yield the lines of all tables of the cases of some groups, or of all cases without any."""
    cases = [case for case in CASES if not groups or case.group in groups]
    yield from (table_row(HEAD), table_rule(1, 7))
    yield from (row(case, kept) for case in cases)
    ordered = [case for case in cases if len(case.spacings) > 1 and case.group != "meshes"]
    meshes = [case for case in cases if case.group == "meshes"]
    tolerant = [case for case in cases if case.tolerances]
    for chosen, table in ((ordered, order_table), (meshes, equal_unknowns_table), (tolerant, tolerance_table)):
        if chosen:
            yield ""
            yield from table(chosen, kept)


def main(arguments: Sequence[str]) -> None:
    """Solve all cases, or those of the groups that are named; all of them are also written."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("groups", nargs="*", help="of cases; all if left out")
    parser.add_argument("--keep", type=Path, metavar="FILE", help="where results are kept, and found again")
    parser.add_argument("--truths", action="store_true", help="find true solutions alone there, and solve the rest")
    given = parser.parse_args(arguments)
    lines = []
    for line in lines_of(given.groups, Kept(given.keep, given.truths)):
        print(line, flush=True)
        lines.append(line)
    if not given.groups:
        TABLE.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
