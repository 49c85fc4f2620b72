"""The contract of a form that a plugin supplies."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from cpmkit.types import Progress

if TYPE_CHECKING:
    from cpmkit.forms.contract import Discretized
    from cpmkit.scene.scene import Scene


class Backend(Protocol):
    """A form of a plugin, another way of discretising scenes; a plugin's factory in ``cpmkit_backends`` returns one.

    The families and linear solvers of the core solve its discretised scenes. ``discretize`` may have further keyword
    arguments: options of the form, which ``solve`` accepts and passes on.
    """

    def discretize(self, scene: Scene, spacing: float | None, *, progress: Progress) -> Discretized:
        """Return the scene in the form's unknowns; ``spacing`` is None if the user gave none.

        Raises
        ------
        CpmkitError
            One sentence: what the form cannot do, and which form can.
        """
