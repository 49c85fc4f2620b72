"""Reaction-diffusion systems: channels that diffuse, each with its own diffusivity, and react at each point."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from cpmkit.errors import InputError, SceneError, shown
from cpmkit.formulas.expressions import ReactionExpression
from cpmkit.runtime.arrays import positive
from cpmkit.scene.conditions import Condition
from cpmkit.scene.data import Data, as_data, is_sequence, read_formula
from cpmkit.scene.equations import Terms
from cpmkit.scene.equations_in_time import Evolution
from cpmkit.scene.pointwise import AfterStep, Reaction


@dataclass(frozen=True, eq=False)
class ReactionDiffusion(Evolution):
    """u_t = div(kappa grad u) + reaction(u) + f for each channel of u, with u = initial at time t0.

    Diffusion is implicit, the reaction explicit: the step must be shorter than the time scale of the fastest reaction.

    Parameters
    ----------
    initial : sequence, number, or callable
        u at the start: one entry for each channel, or a callable of points (n, d) that returns (n, channels).
    reaction : callable, or text
        Formulas, one for each channel, such as ``["u1*u2 - u1", "-u1*u2"]``; or a function of u (p, channels), of
        points (p, d) if it has a second parameter, and of the time if it has a parameter ``t`` without a default, that
        returns rates (p, channels). Its u are values at points of the manifold, not coefficients.
    kappa : number, callable, or a sequence of one for each channel
        Diffusivities, above zero: numbers, or functions of points (n, d) that return (n,).
    until : float
        End time.
    step : float
        Time step; the last step before a frame and before the end is shortened.
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
        If an argument is not accepted.

    Examples
    --------
    On a circle the solution of u_t = Lap u + u (1 - u) tends to 1 if it is positive at the start.

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
        """Replace formulas by functions, convert kappa to a tuple, and check the arguments."""
        super().__post_init__()
        texts: Any = self.reaction
        if isinstance(texts, str) or is_sequence(texts):
            texts = (texts,) if isinstance(texts, str) else tuple(texts)
            object.__setattr__(
                self, "reaction", read_formula(ReactionExpression, texts, "reaction of reaction-diffusion")
            )
        kappa = as_data(self.kappa, "kappa of reaction-diffusion")
        each = tuple(kappa) if not callable(kappa) and np.ndim(np.asarray(kappa, dtype=object)) else (kappa,)
        if not each:
            raise InputError("kappa of reaction-diffusion must be one number or function a channel, got none.")
        self._check(("sbdf2", "euler"), {f"kappa {k} of {len(each)}": value for k, value in enumerate(each, 1)})
        for value in each:
            if not callable(value):
                positive(value, "kappa of reaction-diffusion")
        if not callable(self.reaction):
            raise InputError(
                f"reaction of reaction-diffusion must be a function of u (p, channels), got {shown(self.reaction)}."
            )
        object.__setattr__(self, "kappa", each)

    def terms(self) -> Terms:
        """Return the terms of the spatial part of the first channel."""
        return Terms(self.f, diffusivity=self.kappa[0])

    def terms_of_channels(self, channels: int) -> list[tuple[tuple[int, ...], Terms]]:
        """Return the terms of the spatial part for each different kappa, after the numbers of the channels with it."""
        each = self.kappa * channels if len(self.kappa) == 1 else self.kappa
        different: list[Any] = []
        for kappa in each:
            if not any(_equal(kappa, other) for other in different):
                different.append(kappa)
        return [
            (tuple(k for k, other in enumerate(each) if _equal(other, kappa)), Terms(self.f, diffusivity=kappa))
            for kappa in different
        ]

    def data(self) -> list[tuple[str, Data]]:
        """Return the right-hand side, initial data, kappa and the reaction, each after its name in error messages."""
        data = [
            ("the right-hand side f", self.f),
            ("the initial data", self.initial),
            ("kappa of reaction-diffusion", list(self.kappa)),
        ]
        channels = getattr(self.reaction, "channels", None)  # of formulas
        return [*data, ("the reaction", [0.0] * channels)] if isinstance(channels, int) else data

    def check_conditions(self, conditions: Sequence[tuple[str, Condition]]) -> None:
        """Raise if a condition is not accepted, or couples sides while kappa differs between channels.

        Raises
        ------
        SceneError
            For the first condition that is not accepted.
        """
        super().check_conditions(conditions)
        alike = len(self.terms_of_channels(len(self.kappa))) == 1
        for label, condition in conditions:
            if condition.couples and not alike:
                raise SceneError(
                    f"{label}: {condition.kind!r} takes one kappa for all channels, got {len(self.kappa)} that differ; "
                    "give one number or function, or conditions on each side."
                )

    def __str__(self) -> str:
        each = ", ".join("a function" if callable(value) else f"{value:g}" for value in self.kappa)
        return f"u_t - div(kappa grad u) = reaction(u) + f, kappa = {each}"


def _equal(first: Any, second: Any) -> bool:
    """Return True if two diffusivities are the same function or equal numbers."""
    return first is second or (not callable(first) and not callable(second) and float(first) == float(second))
