"""What an application measures, at a spacing or at the one that an accuracy asks for, and how large its error is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Self, TypeVar

import cpmkit as ck
from cpmkit.applications.heat import barriers, prepared_manifold
from cpmkit.applications.result import Result
from cpmkit.facade import Solution
from cpmkit.preparing import Prepared
from cpmkit.protocols import Floats

if TYPE_CHECKING:
    from cpmkit.accuracy.error_estimate import ErrorEstimate

#: What is asked for in place of a spacing.
ASKED = ("tolerance", "norm", "seconds", "memory")
#: At which errors are taken to fall with the spacing: more on smooth surfaces, about so on ridges and meshes.
ORDER = 1.0


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Measured(Result):
    """What is measured by several solves, the last of which is its solution.

    Attributes
    ----------
    solution : Solution
        What is read, saved and drawn.
    again : callable
        Makes the solution at another spacing and origin of the lattice.
    """

    again: Callable[[float, Any], Solution] | None = None

    @property
    def error(self) -> ErrorEstimate:
        """An estimate of the error, from measuring again at twice the spacing when it is first asked for.

        Errors are taken to fall in proportion to the spacing; on smooth surfaces they fall faster, and the estimate is
        up to ten times too large.

        Raises
        ------
        CpmkitError
            If it cannot be measured at twice the spacing.
        """
        return self.solution.estimated or self._error

    @cached_property
    def _error(self) -> ErrorEstimate:
        assert self.again is not None
        found: ErrorEstimate = ck.estimate_error_by(self.again, self.solution, order=ORDER)
        return found

    def gradient(self, points: Any) -> Floats:
        """Return the tangential gradient (n, d), of length one but at ridges, ends and gaps."""
        slopes: Floats = self.solution.gradient(points)
        return slopes

    def by(self, again: Callable[[float, Any], Solution], solution: Solution | None = None) -> Self:
        """Return the same with what makes it at other spacings, and with a solution that knows its error.

        Without one the solution is not asked for it: it would tell that of the last solve alone.
        """
        return replace(self, again=again, solution=solution or replace(self.solution, estimated=False))


Found = TypeVar("Found", bound=Measured)


def measured(
    surface: Any, spacing: float | None, options: dict[str, Any], measure: Callable[[Prepared], Found]
) -> Found:
    """Measure on a manifold at a spacing, or at one that suffices for the accuracy among the options.

    Raises
    ------
    CpmkitError
        If an option is not accepted, or as ``measure`` does.
    """
    target = {name: options[name] for name in ASKED if name in options}
    if not target or spacing is not None or isinstance(surface, Prepared):
        prepared = prepared_manifold(surface, spacing, options)
        return measure(prepared).by(_again(prepared, measure))
    scene = barriers(surface)
    kept = {name: value for name, value in options.items() if name not in target}
    last: list[Found] = []

    def make(spacing: float, origin: Any) -> Solution:
        last[:] = [measure(prepared_manifold(scene, spacing, {**kept, "origin": kept.get("origin", origin)}))]
        return last[0].solution

    found = ck.solve_by(make, scene, order=ORDER, **target)
    return last[0].by(make, found)


def _again(prepared: Prepared, measure: Callable[[Prepared], Measured]) -> Callable[[float, Any], Solution]:
    """Return what measures at another spacing, with the options that a scene was prepared with."""
    options = prepared.options
    given = {} if options is None else options.as_dict()
    kept = {name: value for name, value in given.items() if name not in ("spacing", "origin")}

    def make(spacing: float, origin: Any) -> Solution:
        made = prepared_manifold(prepared.scene, spacing, {**kept, "origin": origin, "form": prepared.discretized.form})
        return measure(made).solution

    return make
