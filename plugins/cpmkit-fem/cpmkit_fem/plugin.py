"""What this distribution offers to cpmkit: the form ``fem``."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from cpmkit.plugin import Backend, hookimpl
from cpmkit_fem.backend import fem


@hookimpl
def cpmkit_backends() -> Mapping[str, Callable[[], Backend]]:
    """Return the factory of the form."""
    return {"fem": fem}
