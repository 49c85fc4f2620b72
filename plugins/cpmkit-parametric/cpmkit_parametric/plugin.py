"""What this distribution hands to cpmkit: a factory for each kind, and the cases that the laws are checked on."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

from cpmkit.plugin import ClosestPointSource, hookimpl
from cpmkit_parametric import factories, shapes

if TYPE_CHECKING:
    from cpmkit.plugin import ConformanceCase


@hookimpl
def cpmkit_sources() -> Mapping[str, Callable[..., ClosestPointSource]]:
    """Return the factory function of each of the eight kinds, by the name of the kind."""
    return {
        "parametric.curve": factories.curve,
        "parametric.surface": factories.surface,
        "parametric.torus_knot": shapes.torus_knot,
        "parametric.helix": shapes.helix,
        "parametric.planar_curve": shapes.planar_curve,
        "parametric.revolution": shapes.revolution,
        "parametric.moebius": shapes.moebius,
        "parametric.klein": shapes.klein,
    }


@hookimpl
def cpmkit_conformance_cases() -> Sequence[ConformanceCase]:
    """Return the cases; imported here because they need the test extra."""
    from cpmkit_parametric.cases import conformance_cases

    return conformance_cases()
