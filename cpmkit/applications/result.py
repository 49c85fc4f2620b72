"""Results of applications: a solution that is saved and drawn, its error, and the spacing that reaches a target."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Self, TypeVar, Unpack

import cpmkit as ck
from cpmkit.applications.heat import barriers, prepare_manifold
from cpmkit.facade import Solution
from cpmkit.preparing import Prepared
from cpmkit.runtime.deprecation import DeprecatedMember
from cpmkit.types import Floats

if TYPE_CHECKING:
    from cpmkit.accuracy.error_estimate import ErrorEstimate
    from cpmkit.scenefile.look import LookKeywords

#: Order at which errors of distances are assumed to fall: the order on ridges and meshes; smooth surfaces have more.
ORDER = 1.0


@dataclass(frozen=True, eq=False, repr=False)
class Result:
    """The result of an application: read, saved and drawn as a solution.

    Attributes
    ----------
    solution : Solution
        The solution that is read, saved and drawn.
    """

    solution: Solution

    def save(self, path: Any) -> None:
        """Write the solution as :meth:`cpmkit.Solution.save` does."""
        self.solution.save(path)

    def picture(self, path: Any, **options: Unpack[LookKeywords]) -> Any:
        """Draw the result as :meth:`cpmkit.Solution.picture` does."""
        return self.drawable().picture(path, **options)

    def drawable(self) -> Solution:
        """Return the solution that pictures show: its display mesh may have other colours."""
        return self.solution

    drawn = DeprecatedMember("drawable")

    @property
    def _details(self) -> str:
        """Words for ``repr`` beside those of the solution."""
        return ""

    def __repr__(self) -> str:
        figures = repr(self.solution).rpartition("\n")[2].strip()
        return f"{type(self).__name__} on {self.solution.scene.surface!r}{self._details}\n  {figures}"


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Measured(Result):
    """A result of several linear solves, whose error is estimated from the same solves at twice the spacing.

    Attributes
    ----------
    solution : Solution
        The solution that is read, saved and drawn.
    recompute : callable
        Computes the solution at another spacing and origin of the lattice.
    """

    recompute: Callable[[float, Any], Solution] | None = None

    @property
    def error(self) -> ErrorEstimate:
        """An estimate of the error, computed on first use from the result at twice the spacing.

        Errors are assumed to be proportional to the spacing. On smooth surfaces they fall faster, and the estimate is
        up to ten times too large.

        Raises
        ------
        CpmkitError
            If the quantity cannot be computed at twice the spacing.
        """
        return self.solution.estimated or self._error

    @cached_property
    def _error(self) -> ErrorEstimate:
        """The error estimate of :attr:`error`, computed from the result at twice the spacing."""
        assert self.recompute is not None
        estimate: ErrorEstimate = ck.estimate_error_by(self.recompute, self.solution, order=ORDER)
        return estimate

    def gradient(self, points: Any) -> Floats:
        """Return the tangential gradient (n, d), of length one except at ridges, ends and gaps."""
        gradient: Floats = self.solution.gradient(points)
        return gradient

    def with_recompute(self, recompute: Callable[[float, Any], Solution], solution: Solution | None = None) -> Self:
        """Return the result with another function ``recompute`` and, if given, another ``solution``.

        ``recompute`` returns the solution at a spacing and an origin of the lattice. Without a ``solution`` the present
        one is kept, marked so that it makes no error estimate of its own, which would be that of only the last solve.
        """
        return replace(self, recompute=recompute, solution=solution or replace(self.solution, estimated=False))


MeasuredResult = TypeVar("MeasuredResult", bound=Measured)


def measure_to_target(
    surface: Any, spacing: float | None, options: dict[str, Any], measure: Callable[[Prepared], MeasuredResult]
) -> MeasuredResult:
    """Compute a quantity at a spacing, or at the spacing that reaches the accuracy target, and return the result.

    Parameters
    ----------
    surface : ClosestPointSource, Scene or Prepared
        The manifold.
    spacing : float or None
        Spacing of the lattice.
    options : dict
        Options of :func:`cpmkit.prepare`; or ``tolerance``, ``norm``, ``seconds``, ``memory`` in place of a spacing.
    measure : callable
        Computes the quantity on a prepared scene.

    Raises
    ------
    CpmkitError
        If an option is not accepted, or ``measure`` raises it.
    """
    target = {name: options[name] for name in ("tolerance", "norm", "seconds", "memory") if name in options}
    if not target or spacing is not None or isinstance(surface, Prepared):
        prepared = prepare_manifold(surface, spacing, options)
        return measure(prepared).with_recompute(_recompute_like(prepared, measure))
    scene = barriers(surface)
    others = {name: value for name, value in options.items() if name not in target}
    last: list[MeasuredResult] = []

    def recompute(spacing: float, origin: Any) -> Solution:
        last[:] = [measure(prepare_manifold(scene, spacing, {**others, "origin": others.get("origin", origin)}))]
        return last[0].solution

    solution = ck.solve_by(recompute, scene, order=ORDER, **target)
    return last[0].with_recompute(recompute, solution)


def _recompute_like(prepared: Prepared, measure: Callable[[Prepared], Measured]) -> Callable[[float, Any], Solution]:
    """Return a function of a spacing and an origin that measures there and returns the solution.

    It uses the options with which ``prepared`` was prepared.
    """
    options = prepared.options
    every = {} if options is None else options.as_dict()
    others = {name: value for name, value in every.items() if name not in ("spacing", "origin")}

    def recompute(spacing: float, origin: Any) -> Solution:
        options = {**others, "origin": origin, "form": prepared.discretized.form}
        return measure(prepare_manifold(prepared.scene, spacing, options)).solution

    return recompute
