"""A problem in time, discretised in space: M u' = -A u + r(u) + b(t), or M u'' for waves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cpmkit.families.evolution.moment import Moment
from cpmkit.forms.contract import Discretized, conditions_depend_on_time
from cpmkit.linear.protocols import Stiffness
from cpmkit.scene.data import Data, takes_time
from cpmkit.scene.equations import Terms
from cpmkit.scene.pointwise import Reaction, reaction_rates
from cpmkit.types import Floats


@dataclass(frozen=True, eq=False)
class ChannelGroup:
    """The channels that share an operator.

    Attributes
    ----------
    channels : tuple of int
        Their numbers.
    terms : Terms
        Of the equation's spatial part.
    stiffness : Stiffness
        A.
    """

    channels: tuple[int, ...]
    terms: Terms
    stiffness: Stiffness


@dataclass(frozen=True, eq=False)
class SemiDiscrete:
    """A of each group of channels, M, r(u) and b(t).

    Attributes
    ----------
    form : Discretized
        The scene, with M.
    groups : tuple of ChannelGroup
        Every channel is in one of them.
    f : Data
        Right-hand side.
    reaction : callable, optional
        Of values of u, points and the time.
    """

    form: Discretized
    groups: tuple[ChannelGroup, ...]
    f: Data
    reaction: Reaction | None = None

    @property
    def stiffness(self) -> Stiffness:
        """A of the first channel."""
        return self.groups[0].stiffness

    def joined(self, of_group: Callable[[ChannelGroup], Floats]) -> Floats:
        """Return what each group has for its channels, (n, channels)."""
        if len(self.groups) == 1:
            return of_group(self.groups[0])
        joined = np.empty((self.form.size, self.form.channels))
        for group in self.groups:
            joined[:, group.channels] = of_group(group)
        return joined

    def columns(self, group: ChannelGroup, values: Floats) -> Floats:
        """Return the columns of ``values`` (n, channels) that are a group's."""
        return values if len(self.groups) == 1 else np.ascontiguousarray(values[:, group.channels])

    @property
    def moves(self) -> bool:
        """Whether b depends on the time."""
        return takes_time(self.f) or conditions_depend_on_time(self.form.scene)

    @cached_property
    def _load(self) -> Floats:
        return self.form.load(self.f, 0.0)

    @cached_property
    def steady(self) -> Floats:
        """The forcing b (n, channels) at time 0."""
        return self._load + self._data(0.0)

    def forcing(self, time: float) -> Floats:
        """Return b(time), (n, channels); what does not depend on the time is read once."""
        if not self.moves:
            return self.steady
        load = self.form.load(self.f, time) if takes_time(self.f) else self._load
        return load + self._data(time)

    def _data(self, time: float) -> Floats:
        return self.joined(lambda group: self.columns(group, self.form.condition_load(group.stiffness, time)))

    def reacting(self, moment: Moment) -> Floats:
        """Return r(u) at a moment, (n, channels); what the last moments gave is kept."""
        for u, known in self._reactions:
            if u is moment.u:
                return known
        start = self.form.scene.problem.start_time or 0.0
        made = self.form.reaction_load(
            lambda values, points: reaction_rates(self._reaction, values, points, moment.time, start), moment.u
        )
        self._reactions[:] = [*self._reactions[-1:], (moment.u, made)]
        return made

    @property
    def _reaction(self) -> Reaction:
        assert self.reaction is not None
        return self.reaction

    @cached_property
    def _reactions(self) -> list[tuple[Floats, Floats]]:
        return []

    def weighed(self, u: Floats) -> Floats:
        """Return M u."""
        mass = self.form.mass_in_time
        return u if mass is None else mass.apply(u)

    def rate(self, u: Floats, time: float) -> Floats:
        """Return M u' = -A u + b(time)."""
        applied = self.joined(lambda group: group.stiffness.apply(self.columns(group, u)))
        return np.asarray(self.forcing(time) - applied)


def largest_eigenvalue(problem: SemiDiscrete, speed: float) -> float:
    """Return the largest eigenvalue of ``-speed^2 Lap`` by differences of second order on the nodes of a lattice."""
    return float(4 * problem.form.scene.surface.dim * speed**2 / problem.form.spacing**2)
