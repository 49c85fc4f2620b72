"""Pareto fronts of error and cost: attempts that no other beats in both, and the cheapest for each decade of error."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from cpmkit.studies.record_series import Series
from cpmkit.studies.tables import table_row, table_rule

#: The costs of an attempt: name of the attribute, and heading of its column.
COSTS = {"seconds": "CPU seconds", "mebibytes": "MiB"}
BYTES_PER_MEBIBYTE = 2**20
#: Smaller errors, as shares of the range, are rounding; they count as this large.
LEAST_ERROR = 1e-16


@dataclass(frozen=True)
class Attempt:
    """One entry of a series, with its error and its costs: the result of one method at one resolution.

    Attributes
    ----------
    label, setting : str
        The method with its options; its spacing or accuracy target.
    error : float
        Root mean square error as a share of the solution's range; in the unit of the solution where it is constant.
    seconds, mebibytes : float
        CPU seconds and peak memory; nan where they were not recorded.
    """

    label: str
    setting: str
    error: float
    seconds: float
    mebibytes: float

    def cost(self, name: str) -> float:
        """Return the cost ``name``, a key of :data:`COSTS`."""
        return float(getattr(self, name))

    def __str__(self) -> str:
        return f"{self.label}, {self.setting}"


def attempts(series: Sequence[Series]) -> list[Attempt]:
    """Return every entry of all series as an attempt."""
    made = []
    for one in series:
        for entry in one.entries:
            unit = 2 * entry.half_range if entry.half_range > 0 else 1.0
            setting = f"{one.target} {entry.target:g}" if one.target else f"spacing {entry.spacing:g}"
            mebibytes = entry.bytes / BYTES_PER_MEBIBYTE
            made.append(Attempt(one.label, setting, entry.rms_error / unit, entry.cpu_seconds, mebibytes))
    return made


def front(made: Sequence[Attempt], cost: str) -> list[Attempt]:
    """Return the Pareto front: the attempts that no other beats in both error and ``cost``, the cheapest first."""
    best, kept = math.inf, []
    priced = [one for one in made if not math.isnan(one.cost(cost))]
    for one in sorted(priced, key=lambda one: (one.cost(cost), one.error)):
        if one.error < best:
            best = one.error
            kept.append(one)
    return kept


def cheapest_by_decade(made: Sequence[Attempt], cost: str) -> dict[int, Attempt]:
    """Return, for each decade of the errors on the Pareto front, the cheapest attempt with an error of at most 10^k.

    The keys are the whole numbers k, the largest first.
    """
    on_front = front(made, cost)
    if not on_front:
        return {}
    powers = [math.ceil(math.log10(max(one.error, LEAST_ERROR))) for one in (on_front[0], on_front[-1])]
    return {
        power: next(one for one in on_front if one.error <= 10.0**power)
        for power in range(powers[0], powers[1] - 1, -1)
        if on_front[-1].error <= 10.0**power
    }


def winners_table(made: Sequence[Attempt]) -> str:
    """Return a Markdown table: for each decade of error, the attempt that reaches it at the least of each cost."""
    costs = [cost for cost in COSTS if front(made, cost)]
    found = {cost: cheapest_by_decade(made, cost) for cost in costs}
    heads = [head for cost in costs for head in (f"least {COSTS[cost]}", COSTS[cost])]
    lines = [table_row(["rms error below", *heads]), "|--:|" + "---|--:|" * len(costs)]
    for power in sorted({power for one in found.values() for power in one}, reverse=True):
        cells = []
        for cost in costs:
            one = found[cost].get(power)
            cells += ["", ""] if one is None else [str(one), f"{one.cost(cost):.3g}"]
        lines.append(table_row([f"1e{power:d}", *cells]))
    return "\n".join(lines)


def front_table(made: Sequence[Attempt]) -> str:
    """Return a Markdown table of the attempts on the Pareto fronts of error and each cost, the largest error first."""
    fronts = {cost: front(made, cost) for cost in COSTS}
    kept = sorted({one for on_front in fronts.values() for one in on_front}, key=lambda one: -one.error)
    lines = [table_row(["", "", "unbeaten in", "rms error", *COSTS.values()]), table_rule(3, 1 + len(COSTS))]
    for one in kept:
        where = " and ".join(COSTS[cost] for cost, on_front in fronts.items() if one in on_front)
        paid = ["" if math.isnan(one.cost(cost)) else f"{one.cost(cost):.3g}" for cost in COSTS]
        lines.append(table_row([one.label, one.setting, where, f"{one.error:.2e}", *paid]))
    return "\n".join(lines)
