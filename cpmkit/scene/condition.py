"""What every condition tells of itself: a new kind is one class with these answers, wherever it is defined."""

from __future__ import annotations

from abc import ABC, abstractmethod
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

from cpmkit.runtime.arrays import whole
from cpmkit.scene.data import Data
from cpmkit.scene.formula_data import read_formulas
from cpmkit.scene.laws import Interface, Law, OneSided, data_of

if TYPE_CHECKING:
    from cpmkit.scene.equations import Equation


class Condition(ABC):
    """What holds on a side of a boundary, on an edge, or across a boundary.

    A kind is a frozen dataclass of what it is given; its parameters are told in summaries, and two conditions are the
    same where they are.

    Attributes
    ----------
    kind : str
        Its name in reports, and in scene files.
    order : 1 to 4, or None
        Overrides the discretisation's order for this condition.
    """

    kind: ClassVar[str]
    order: int | None = None

    def __post_init__(self) -> None:
        read_formulas(self, self.kind)
        if self.order is not None:
            whole(self.order, f"order of {type(self).__name__}", 1, 4)

    def __init_subclass__(cls, **keywords: Any) -> None:
        """Keep the law that a kind answers: by that one object the data that it gives are known again."""
        super().__init_subclass__(**keywords)
        own = cls.__dict__.get("law")
        if isinstance(own, property) and own.fget is not None:
            kept: cached_property[Law] = cached_property(own.fget)
            kept.__set_name__(cls, "law")
            cls.law = kept  # type: ignore[assignment]

    @property
    @abstractmethod
    def law(self) -> Law:
        """Which of the standard laws it is; asked once."""

    @property
    def couples(self) -> bool:
        """True where it holds across a boundary, and not on one side."""
        return isinstance(self.law, Interface)

    @property
    def one_sided(self) -> OneSided:
        """The law of a condition that does not couple sides."""
        law = self.law
        assert not isinstance(law, Interface)
        return law

    def data(self) -> list[tuple[str, Data]]:
        """Return the data that have channels, and what each is."""
        return data_of(self.law)

    def refusal(self, problem: Equation) -> str:
        """Return why an equation does not take it, the predicate of a sentence; empty where it does."""
        return "" if problem.family in self.law.families else self.law.needs
