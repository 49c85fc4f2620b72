"""What this distribution offers to cpmkit: the back end ``fem``."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from cpmkit.hookspecs import hookimpl
from cpmkit.protocols import Backend
from cpmkit_fem.backend import fem


@hookimpl
def cpmkit_backends() -> Mapping[str, Callable[[], Backend]]:
    """Return the factory of the back end."""
    return {"fem": fem}
