"""What this distribution offers to cpmkit: the form ``fem``, and ``fem-pinned`` to compare with."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from cpmkit.plugin import Backend, hookimpl
from cpmkit_fem.backend import fem, fem_pinned


@hookimpl
def cpmkit_backends() -> Mapping[str, Callable[[], Backend]]:
    """Return the factory functions of the forms "fem" and "fem-pinned", by name."""
    return {"fem": fem, "fem-pinned": fem_pinned}
