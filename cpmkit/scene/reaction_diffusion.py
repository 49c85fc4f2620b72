"""Reaction and diffusion: channels that spread, each at its own rate, and act on each other where they are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from cpmkit.errors import InputError, SceneError, shown
from cpmkit.formulas.expressions import ReactionExpression
from cpmkit.runtime.arrays import positive
from cpmkit.scene.conditions import Condition
from cpmkit.scene.data import Data, as_data, read_formula
from cpmkit.scene.equations import Terms
from cpmkit.scene.equations_in_time import Evolution
from cpmkit.scene.laws import Interface
from cpmkit.scene.pointwise import AfterStep, Reaction

REACTION_SCHEMES = ("sbdf2", "euler")


@dataclass(frozen=True, eq=False)
class ReactionDiffusion(Evolution):
    """u_t = div(kappa grad u) + reaction(u) + f for each channel of u, from u = initial at time t0.

    Diffusion is taken implicitly, the reaction explicitly: any step suits the diffusion, and one shorter than the time
    in which the fastest part of the reaction acts suits the reaction.

    Parameters
    ----------
    initial : sequence, number, or callable
        u at the start: one entry a channel, or a callable of points (n, d) that returns (n, channels).
    reaction : callable, or text
        Formulas, one a channel, such as ``["u1*u2 - u1", "-u1*u2"]``; or a function of u (p, channels), of points
        (p, d) where it has a second parameter, and of the time where it has a parameter ``t`` without a default, that
        returns rates (p, channels). It is called with values of u at points of the
        manifold, never with coefficients.
    kappa : number, callable, or a sequence of one a channel
        Diffusivities, above zero: numbers, or functions of points (n, d) that return (n,).
    until : float
        Time at which the run ends.
    step : float
        Time step; the last one before a frame and before the end is shortened.
    scheme : str
        ``sbdf2``, of second order: BDF2 with the reaction extrapolated from two steps (Ascher, Ruuth and Wetton 1995);
        ``euler``, of first order.
    f : number, sequence, or callable
        Source, as of :class:`~cpmkit.Heat`.
    frames : int or sequence of float
        As for :class:`~cpmkit.Heat`.
    after_step, rest, t0
        As for :class:`~cpmkit.Heat`.

    Raises
    ------
    InputError
        If an argument is not what is accepted.

    Examples
    --------
    On a circle, u_t = Lap u + u (1 - u) goes to 1 wherever it begins above zero.

    >>> import cpmkit as ck
    >>> growth = ck.ReactionDiffusion(0.1, lambda u: u * (1 - u), kappa=0.1, until=10.0, step=0.1)
    >>> solution = ck.solve(ck.Scene(ck.source("analytic.circle"), growth), spacing=0.2)
    >>> solution.evaluate([[1, 0]]).round(2)
    array([1.])
    """

    initial: Data
    reaction: Reaction | str | Sequence[str]
    kappa: Any
    until: float
    step: float
    scheme: str = "sbdf2"
    f: Data = 0.0
    frames: int | Sequence[float] = 0
    after_step: AfterStep | None = None
    rest: float | None = None
    t0: float = 0.0
    kind: ClassVar[str] = "reaction-diffusion"

    def __post_init__(self) -> None:
        super().__post_init__()
        if isinstance(self.reaction, (str, list, tuple)):
            texts = (self.reaction,) if isinstance(self.reaction, str) else tuple(self.reaction)
            object.__setattr__(
                self, "reaction", read_formula(ReactionExpression, texts, "reaction of reaction-diffusion")
            )
        given = as_data(self.kappa, "kappa of reaction-diffusion")
        each = tuple(given) if isinstance(given, (list, tuple, np.ndarray)) and np.ndim(given) else (given,)
        if not each:
            raise InputError("kappa of reaction-diffusion must be one number or function a channel, got none.")
        self._check(REACTION_SCHEMES, {f"kappa {k} of {len(each)}": one for k, one in enumerate(each, 1)})
        for one in each:
            if not callable(one):
                positive(one, "kappa of reaction-diffusion")
        if not callable(self.reaction):
            raise InputError(
                f"reaction of reaction-diffusion must be a function of u (p, channels), got {shown(self.reaction)}."
            )
        object.__setattr__(self, "kappa", each)

    def terms(self) -> Terms:
        """Return the terms of the first channel's spatial part."""
        return Terms(self.f, diffusivity=self.kappa[0])

    def terms_of_channels(self, channels: int) -> list[tuple[tuple[int, ...], Terms]]:
        """Return the terms of the channels' spatial parts, with the numbers of the channels that share them."""
        each = self.kappa * channels if len(self.kappa) == 1 else self.kappa
        different: list[Any] = []
        for one in each:
            if not any(_same(one, other) for other in different):
                different.append(one)
        return [
            (tuple(k for k, one in enumerate(each) if _same(one, kappa)), Terms(self.f, diffusivity=kappa))
            for kappa in different
        ]

    def data(self) -> list[tuple[str, Data]]:
        """Return what has channels, by the names that errors use."""
        given = [
            ("the right-hand side f", self.f),
            ("the initial data", self.initial),
            ("kappa of reaction-diffusion", list(self.kappa)),
        ]
        channels = getattr(self.reaction, "channels", None)  # formulas tell how many they are for
        return [*given, ("the reaction", [0.0] * channels)] if isinstance(channels, int) else given

    def check_conditions(self, conditions: Sequence[tuple[str, Condition]]) -> None:
        """Refuse transmission too where channels differ in kappa: its conductivities are those of one equation."""
        super().check_conditions(conditions)
        alike = len(self.terms_of_channels(len(self.kappa))) == 1
        for label, condition in conditions:
            if isinstance(condition.law, Interface) and not alike:
                raise SceneError(
                    f"{label}: {condition.kind!r} takes one kappa for all channels, got {len(self.kappa)} that differ; "
                    "give one number or function, or conditions on each side."
                )

    def __str__(self) -> str:
        each = ", ".join("a function" if callable(one) else f"{one:g}" for one in self.kappa)
        return f"u_t - div(kappa grad u) = reaction(u) + f, kappa = {each}"


def _same(one: Any, other: Any) -> bool:
    return one is other or (not callable(one) and not callable(other) and float(one) == float(other))
