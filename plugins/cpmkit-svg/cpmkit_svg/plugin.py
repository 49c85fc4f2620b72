"""What this distribution offers to cpmkit: curves of SVG files."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

from cpmkit.plugin import ClosestPointSource, hookimpl
from cpmkit_svg.path import path

if TYPE_CHECKING:
    from cpmkit.plugin import ConformanceCase


@hookimpl
def cpmkit_sources() -> Mapping[str, Callable[..., ClosestPointSource]]:
    """Return the factory function of the kind ``svg.path``."""
    return {"svg.path": path}


@hookimpl
def cpmkit_conformance_cases() -> Sequence[ConformanceCase]:
    """Return the conformance cases of SVG path data: open and closed curves of lines, arcs and cubics."""
    from cpmkit_svg.conformance import cases

    return cases()
