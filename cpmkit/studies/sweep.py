"""What a study varies, and the runs that this makes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from itertools import product
from math import prod
from typing import Any

import numpy as np

from cpmkit.errors import InputError, SceneError, shown
from cpmkit.forms.choice import FORMS, every_option
from cpmkit.plugins import call, check_keys
from cpmkit.protocols import Floats
from cpmkit.runtime.arrays import positive
from cpmkit.runtime.declared import declared
from cpmkit.runtime.key_types import check_types

#: Methods that fix nodes, and the options that they have: no order of their own.
BASELINES = {"nearest": ("degree",), "ball": ("degree",)}
#: The form that ``cpm`` is, and whose options a study lists: the paper's.
LISTED_FORM = "collocation"
#: More positions of the lattice, or runs in all, are a mistake.
MOST_ORIGINS, MOST_RUNS = 10_000, 100_000
#: The seed of the random positions of the lattice.
ORIGINS_SEED = 1


def closest_points() -> dict[str, dict[str, Any]]:
    """Return the methods on a lattice, and the options that each sets: ``cpm`` the form alone."""
    options = every_option().items()
    return {"cpm": {"form": LISTED_FORM}} | {
        method: {name: value} for name, one in options for method, value in one.methods.items()
    }


def listed() -> dict[str, str]:
    """Return the options whose values a study lists, and the key of each list."""
    return {name: one.plural or f"{name}s" for name, one in declared(FORMS[LISTED_FORM]).items() if not one.methods}


def listed_of(method: str) -> tuple[str, ...]:
    """Return those of them that a method has."""
    methods = closest_points()
    if method not in methods:
        return BASELINES.get(method, ())
    own = declared(FORMS[methods[method].get("form", LISTED_FORM)])
    return tuple(name for name in listed() if name in own)


def read_sweep(table: Mapping[str, Any]) -> Sweep:
    """Return the sweep of the table [sweep]; a SceneError says which key or value is not accepted."""
    lists = {name: key for name, key in listed().items() if key in table}
    own = {key: value for key, value in table.items() if key not in lists.values()}
    make = partial(Sweep, {name: table[key] for name, key in lists.items()})
    check_keys(make, "[sweep]", own, tuple(listed().values()))
    check_types(Sweep, "[sweep]", own)
    return call(make, "[sweep]", own)


@dataclass(frozen=True, eq=False)
class Sweep:
    """What is varied.

    Attributes
    ----------
    lists : mapping
        The values of options, by the options' names; one that is not named has its default.
    spacings : list of float
        Of the lattice, in the scene's unit.
    cheap : list of float
        The spacings of ``--cheap``: those of tests and first looks. Unless given, all but the finest.
    origins : int
        At how many random positions of the lattice each run is made; 1 is the lattice's own position.
    methods : list of str
        ``cpm``, another of :func:`closest_points`, ``nearest``, ``ball``, or the name of a plugin's back end.
    step_per_spacing : float, optional
        For problems with a time step: the longest one, as a multiple of the spacing.
    """

    lists: Mapping[str, list[Any]]
    spacings: list[float]
    cheap: list[float] | None = None
    origins: int = 1
    methods: tuple[str, ...] | list[str] = ("cpm",)
    step_per_spacing: float | None = None

    def __post_init__(self) -> None:
        own = {key: getattr(self, key) for key in ("spacings", "cheap", "methods")}
        for key, value in {**own, **{listed()[name]: values for name, values in self.lists.items()}}.items():
            if value is not None and (not isinstance(value, (list, tuple)) or not value):
                raise SceneError(f"{key} of [sweep] must be a list with at least one entry, got {shown(value)}.")
        if type(self.origins) is not int or not 0 < self.origins <= MOST_ORIGINS:
            raise SceneError(
                f"origins of [sweep] must be a whole number above zero, {MOST_ORIGINS} at most, got "
                f"{shown(self.origins)}."
            )
        wrong_methods = [method for method in self.methods if not isinstance(method, str)]
        if wrong_methods:
            raise SceneError(f"methods of [sweep] must be names such as 'cpm', got {shown(wrong_methods[0])}.")
        most = max(len(self.spacings), len(self.cheap or []))
        count = most * prod(len(one) for one in (*self.lists.values(), self.methods)) * self.origins
        if count > MOST_RUNS:
            raise SceneError(f"[sweep] makes {count} runs, at most {MOST_RUNS} are accepted; leave some values out.")
        try:
            for value in [*self.spacings, *(self.cheap or [])]:
                positive(value, "each spacing of [sweep]")
            if self.step_per_spacing is not None:
                positive(self.step_per_spacing, "step_per_spacing of [sweep]")
            for name, values in self.lists.items():
                for value in values:
                    declared(FORMS[LISTED_FORM])[name].check(value, f"{listed()[name]} of [sweep]")
            for together in product(*self.lists.values()):
                FORMS[LISTED_FORM](**dict(zip(self.lists, together, strict=True)))
        except InputError as error:
            raise SceneError(str(error)) from error

    def runs(self, cheap: bool = False) -> list[Run]:
        """Return the runs, spacing by spacing; none twice."""
        spacings = (self.cheap or self.spacings[:-1] or self.spacings) if cheap else self.spacings
        every = (
            Run(method, float(spacing), options, origin)
            for spacing in spacings
            for method in self.methods
            for options, origin in self._discretizations(method)
        )
        return list(dict.fromkeys(every))

    def _discretizations(self, method: str) -> Iterator[tuple[tuple[tuple[str, Any], ...], int | None]]:
        """Yield options and number of the origin, None where a method has none."""
        names = listed_of(method)
        lists = [self.lists.get(name, [getattr(FORMS[LISTED_FORM], name)]) for name in names]
        placed = names or method in closest_points()
        origins = range(self.origins) if self.origins > 1 and placed else [None]
        for values in product(*lists):
            yield from product([tuple(zip(names, values, strict=True))], origins)


@dataclass(frozen=True)
class Run:
    """One solve of a study.

    Attributes
    ----------
    method : str
        One of :func:`closest_points`, a baseline or a back end.
    spacing : float
        Of the lattice; of a back end whatever it makes of it.
    options : tuple of (str, value)
        Those that the method has of the options whose values a study lists.
    origin : int or None
        Number of the lattice's random position; None: its own.
    """

    method: str
    spacing: float
    options: tuple[tuple[str, Any], ...]
    origin: int | None

    @classmethod
    def of(cls, record: Mapping[str, Any]) -> Run:
        """Return the run of a record; an option that it does not know yet had its default."""
        names = listed_of(record["method"])
        options = tuple((name, record.get(name, getattr(FORMS[LISTED_FORM], name))) for name in names)
        return cls(record["method"], record["spacing"], options, record["origin"])

    def as_dict(self) -> dict[str, Any]:
        """Return the parameters as plain values, None where the method has no such option."""
        options = dict.fromkeys(listed()) | dict(self.options)
        return {"method": self.method, "spacing": self.spacing, **options, "origin": self.origin}

    def shift(self, dim: int) -> Floats:
        """Return by how much (d,) the lattice is moved: uniformly distributed between 0 and a spacing."""
        if self.origin is None:
            return np.zeros(dim)
        positions = np.random.default_rng(ORIGINS_SEED).uniform(0, 1, (self.origin + 1, dim))
        return np.asarray(self.spacing * positions[self.origin])
