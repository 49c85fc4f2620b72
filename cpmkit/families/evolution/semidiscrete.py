"""A problem in time, discretised in space: M u' = -A u + b(t), or M u'' for waves, and where it starts."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cpmkit.forms.contract import Discretized
from cpmkit.protocols import Floats, Stiffness
from cpmkit.scene.data import Data, takes_time


@dataclass(frozen=True, eq=False)
class SemiDiscrete:
    """A, M and b(t).

    Attributes
    ----------
    form : Discretized
        The scene, with M.
    stiffness : Stiffness
        A.
    f : Data
        Right-hand side.
    """

    form: Discretized
    stiffness: Stiffness
    f: Data

    @property
    def moves(self) -> bool:
        """Whether b depends on the time."""
        return takes_time(self.f) or self.form.data_move

    @cached_property
    def largest_eigenvalue(self) -> float:
        """A bound of A's eigenvalues."""
        return self.form.largest_eigenvalue(self.stiffness)

    @cached_property
    def _load(self) -> Floats:
        return self.form.load(self.f, 0.0)

    @cached_property
    def steady(self) -> Floats:
        """The forcing b (n, channels) at time 0."""
        return self._load + self.form.data(self.stiffness, 0.0)

    def forcing(self, time: float) -> Floats:
        """Return b(time), (n, channels); what does not depend on the time is read once."""
        if not self.moves:
            return self.steady
        load = self.form.load(self.f, time) if takes_time(self.f) else self._load
        return load + self.form.data(self.stiffness, time)

    def weighed(self, u: Floats) -> Floats:
        """Return M u."""
        mass = self.form.mass_in_time
        return u if mass is None else mass.apply(u)

    def rate(self, u: Floats, time: float) -> Floats:
        """Return M u' = -A u + b(time)."""
        return np.asarray(self.forcing(time) - self.stiffness.apply(u))
