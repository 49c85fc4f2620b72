"""What a study varies, and the runs that this makes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from itertools import product
from math import prod
from typing import Any

import numpy as np

from cpmkit.errors import InputError, SceneError, shown
from cpmkit.protocols import Floats
from cpmkit.runtime.arrays import positive

#: The closest point method, by what its options make of sheets that share a band, and of fluxes.
CLOSEST_POINTS: dict[str, dict[str, Any]] = {
    "cpm": {},
    "plain": {"sheets": False},
    "unfolded": {"sheets": "unfolded"},
    "balanced": {"balance": 5},
}
#: Methods that fix nodes: they have no order of their own.
BASELINES = ("nearest", "ball")
#: More positions of the lattice, or runs in all, are a mistake.
MOST_ORIGINS, MOST_RUNS = 10_000, 100_000
#: The lowest degree of interpolation that a fourth order keeps.
FOURTH = 4
#: The seed of the random positions of the lattice.
SEED = 1


@dataclass(frozen=True, eq=False)
class Sweep:
    """What is varied.

    Attributes
    ----------
    spacings : list of float
        Of the lattice, in the scene's unit.
    cheap : list of float
        The spacings of ``--cheap``: those of tests and first looks. Unless given, all but the finest.
    degrees : list of int
        Of the interpolation.
    orders : list of int
        Of the conditions.
    origins : int
        At how many random positions of the lattice each run is made; 1 is the lattice's own position.
    methods : list of str
        ``cpm``, ``plain`` (which does not tell sheets apart), ``unfolded`` (which unfolds sharp bends, too),
        ``balanced`` (which balances fluxes against polynomials of degree 5),
        ``nearest``, ``ball``, or the name of a plugin's back end.
    step_per_spacing : float, optional
        For problems with a time step: the longest one, as a multiple of the spacing.
    """

    spacings: list[float]
    cheap: list[float] | None = None
    degrees: tuple[int, ...] | list[int] = (3,)
    orders: tuple[int, ...] | list[int] = (2,)
    origins: int = 1
    methods: tuple[str, ...] | list[str] = ("cpm",)
    step_per_spacing: float | None = None

    def __post_init__(self) -> None:
        for key in ("spacings", "cheap", "degrees", "orders", "methods"):
            value = getattr(self, key)
            if value is not None and (not isinstance(value, (list, tuple)) or not value):
                raise SceneError(f"{key} of [sweep] must be a list with at least one entry, got {shown(value)}.")
        if type(self.origins) is not int or not 0 < self.origins <= MOST_ORIGINS:
            raise SceneError(
                f"origins of [sweep] must be a whole number above zero, {MOST_ORIGINS} at most, got "
                f"{shown(self.origins)}."
            )
        for key, accepted in (("degrees", (2, 3, 4, 5)), ("orders", (1, 2, 3, 4))):
            wrong = [value for value in getattr(self, key) if type(value) is not int or value not in accepted]
            if wrong:
                raise SceneError(
                    f"{key} of [sweep] must be among {', '.join(map(str, accepted))}, got {shown(wrong[0])}."
                )
        low = min(self.degrees)
        if 4 in self.orders and low < FOURTH:
            raise SceneError(f"order 4 needs degrees of 4 or 5, and degrees of [sweep] has {low}; make two studies.")
        wrong_methods = [method for method in self.methods if not isinstance(method, str)]
        if wrong_methods:
            raise SceneError(f"methods of [sweep] must be names such as 'cpm', got {shown(wrong_methods[0])}.")
        try:
            for value in [*self.spacings, *(self.cheap or [])]:
                positive(value, "each spacing of [sweep]")
            if self.step_per_spacing is not None:
                positive(self.step_per_spacing, "step_per_spacing of [sweep]")
        except InputError as error:
            raise SceneError(str(error)) from error
        most = max(len(self.spacings), len(self.cheap or []))
        count = most * prod(len(one) for one in (self.degrees, self.orders, self.methods)) * self.origins
        if count > MOST_RUNS:
            raise SceneError(f"[sweep] makes {count} runs, at most {MOST_RUNS} are accepted; leave some values out.")

    def runs(self, cheap: bool = False) -> list[Run]:
        """Return the runs, spacing by spacing; none twice."""
        spacings = (self.cheap or self.spacings[:-1] or self.spacings) if cheap else self.spacings
        every = (
            Run(method, float(spacing), degree, order, origin)
            for spacing in spacings
            for method in self.methods
            for degree, order, origin in self._discretizations(method)
        )
        return list(dict.fromkeys(every))

    def _discretizations(self, method: str) -> Iterator[tuple[int | None, int | None, int | None]]:
        """Yield degree, order and number of the origin, None where a method has none."""
        if method not in (*CLOSEST_POINTS, *BASELINES):
            yield None, None, None
            return
        orders = self.orders if method in CLOSEST_POINTS else [None]
        origins = range(self.origins) if self.origins > 1 else [None]
        yield from product(self.degrees, orders, origins)


@dataclass(frozen=True)
class Run:
    """One solve of a study.

    Attributes
    ----------
    method : str
        ``cpm``, ``plain``, a baseline or a back end.
    spacing : float
        Of the lattice; of a back end whatever it makes of it.
    degree, order : int or None
        Of interpolation and conditions; None where the method has none.
    origin : int or None
        Number of the lattice's random position; None: its own.
    """

    method: str
    spacing: float
    degree: int | None
    order: int | None
    origin: int | None

    def as_dict(self) -> dict[str, Any]:
        """Return the parameters as plain values."""
        return asdict(self)

    def shift(self, dim: int) -> Floats:
        """Return by how much (d,) the lattice is moved: uniformly distributed between 0 and a spacing."""
        if self.origin is None:
            return np.zeros(dim)
        positions = np.random.default_rng(SEED).uniform(0, 1, (self.origin + 1, dim))
        return np.asarray(self.spacing * positions[self.origin])
