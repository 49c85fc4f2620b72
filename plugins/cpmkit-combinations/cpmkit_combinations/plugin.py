"""The hooks of this distribution: a factory for each kind, and the cases on which the laws are checked."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

from cpmkit.plugin import ClosestPointSource, hookimpl
from cpmkit_combinations.cut import function_cut, plane_cut
from cpmkit_combinations.moved import moved_source
from cpmkit_combinations.points import points
from cpmkit_combinations.solid import solid
from cpmkit_combinations.trimmed import trimmed_source
from cpmkit_combinations.tube import tube
from cpmkit_combinations.union import union

if TYPE_CHECKING:
    from cpmkit.plugin import ConformanceCase


@hookimpl
def cpmkit_sources() -> Mapping[str, Callable[..., ClosestPointSource]]:
    """Return the factory function of each kind of source, by the name of the kind."""
    return {
        "union": union,
        "moved": moved_source,
        "solid": solid,
        "trimmed": trimmed_source,
        "tube": tube,
        "cut.plane": plane_cut,
        "cut.function": function_cut,
        "points": points,
    }


@hookimpl
def cpmkit_conformance_cases() -> Sequence[ConformanceCase]:
    """Return the conformance cases; their module is imported here because it needs the test extra."""
    from cpmkit_combinations.cases import conformance_cases

    return conformance_cases()
