"""What the results of applications share: a solution that is written and drawn, and two lines at a prompt."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Unpack

from cpmkit.facade import Solution

if TYPE_CHECKING:
    from cpmkit.scenefile.look import LookKeywords


@dataclass(frozen=True, eq=False, repr=False)
class Result:
    """What an application has found: read, saved and drawn as a solution.

    Attributes
    ----------
    solution : Solution
        What is read, saved and drawn.
    """

    solution: Solution

    def save(self, path: Any) -> None:
        """Write it as :meth:`cpmkit.Solution.save` does."""
        self.solution.save(path)

    def picture(self, path: Any, **options: Unpack[LookKeywords]) -> Any:
        """Draw it as :meth:`cpmkit.Solution.picture` does."""
        return self.drawn().picture(path, **options)

    def drawn(self) -> Solution:
        """Return what its pictures show: a solution whose display mesh may have other colours."""
        return self.solution

    @property
    def _told(self) -> str:
        """What there is to say of it beside its solution."""
        return ""

    def __repr__(self) -> str:
        figures = repr(self.solution).rpartition("\n")[2].strip()
        return f"{type(self).__name__} on {self.solution.scene.surface!r}{self._told}\n  {figures}"
