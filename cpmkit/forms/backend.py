"""The contract of a form that a plugin supplies."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from cpmkit.types import Progress

if TYPE_CHECKING:
    from cpmkit.forms.contract import Discretized
    from cpmkit.scene.scene import Scene


class Backend(Protocol):
    """A form that a plugin supplies, returned by the plugin's factory in ``cpmkit_backends``.

    The families and linear solvers of the core solve its discretised scenes. ``discretize`` may have further keyword
    arguments: options of the form, which ``solve`` accepts and passes on.
    """

    def discretize(self, scene: Scene, spacing: float | None, *, progress: Progress) -> Discretized:
        """Return the discretised scene; ``spacing`` is None if the user gave none.

        Raises
        ------
        CpmkitError
            If the form cannot discretise the scene; the message names a form that can.
        """
