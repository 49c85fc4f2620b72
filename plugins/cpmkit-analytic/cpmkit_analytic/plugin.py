"""What this distribution hands to cpmkit: a factory for each kind, and the cases that the laws are checked on."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

from cpmkit.plugin import ClosestPointSource, hookimpl
from cpmkit_analytic import factories

if TYPE_CHECKING:
    from cpmkit.plugin import ConformanceCase


@hookimpl
def cpmkit_sources() -> Mapping[str, Callable[..., ClosestPointSource]]:
    """Return the factory function of each of the nine kinds, by the name of the kind."""
    return {
        "analytic.point": factories.point,
        "analytic.segment": factories.segment,
        "analytic.circle": factories.circle,
        "analytic.arc": factories.arc,
        "analytic.sphere": factories.sphere,
        "analytic.cap": factories.cap,
        "analytic.torus": factories.torus,
        "analytic.cylinder": factories.cylinder,
        "analytic.box": factories.box,
    }


@hookimpl
def cpmkit_conformance_cases() -> Sequence[ConformanceCase]:
    """Return the conformance cases of all nine kinds; imported here because they need the test extra."""
    from cpmkit_analytic.cases import conformance_cases

    return conformance_cases()
