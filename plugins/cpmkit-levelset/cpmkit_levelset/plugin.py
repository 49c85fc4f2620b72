"""What this distribution hands to cpmkit: a factory for each kind, and the cases that the laws are checked on."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

from cpmkit.plugin import ClosestPointSource, hookimpl
from cpmkit_levelset import factories

if TYPE_CHECKING:
    from cpmkit.plugin import ConformanceCase


@hookimpl
def cpmkit_sources() -> Mapping[str, Callable[..., ClosestPointSource]]:
    """Return the factory function of each of the seven kinds, by the name of the kind."""
    return {
        "levelset.expression": factories.expression,
        "levelset.callable": factories.function,
        "levelset.grid": factories.grid,
        "levelset.dziuk": factories.dziuk,
        "levelset.decotetrahedron": factories.decotetrahedron,
        "levelset.tooth": factories.tooth,
        "levelset.goursat": factories.goursat,
    }


@hookimpl
def cpmkit_conformance_cases() -> Sequence[ConformanceCase]:
    """Return the cases; imported here because they need the test extra."""
    from cpmkit_levelset.cases import conformance_cases

    return conformance_cases()
