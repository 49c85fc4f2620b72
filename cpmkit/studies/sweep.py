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
from cpmkit.forms.accuracy_target import AccuracyTarget
from cpmkit.forms.choice import FORMS, every_option
from cpmkit.plugins import call, check_keys
from cpmkit.runtime.arrays import positive
from cpmkit.runtime.options import check_key_types, declared_options
from cpmkit.types import Floats

#: Methods that fix nodes, and the options that they have: no order of their own.
BASELINES = {"nearest": ("degree",), "ball": ("degree",)}
#: Methods that former releases had.
REMOVED_METHODS = ("balanced", "unfolded")
#: The method that is the back end ``fem`` on a refined mesh.
REFINED = "fem-refined"
#: The form that ``cpm`` is, and whose options a study lists: the paper's.
LISTED_FORM = "collocation"
#: What is asked for in place of a spacing, and the key of the list of each; how fine solutions are, in all.
ASKED = {"tolerance": "tolerances", "seconds": "seconds"}
FINENESS = ("spacings", *ASKED.values())
ASKED_ENTRIES = tuple(f"asked_{name}" for name in ASKED)
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
    return {
        name: one.plural or f"{name}s" for name, one in declared_options(FORMS[LISTED_FORM]).items() if not one.methods
    }


def listed_of(method: str) -> tuple[str, ...]:
    """Return those of them that a method has."""
    if method not in closest_points():
        return BASELINES.get(method, ())
    return tuple(name for name in listed() if name in declared_options(_form_of(method)))


def _form_of(method: str) -> Any:
    """Return the options of a method's form; baselines have those of the first."""
    return FORMS[closest_points().get(method, {}).get("form", LISTED_FORM)]


def read_sweep(table: Mapping[str, Any]) -> Sweep:
    """Return the sweep of the table [sweep]; a SceneError says which key or value is not accepted."""
    lists = {name: key for name, key in listed().items() if key in table}
    own = {key: value for key, value in table.items() if key not in lists.values()}
    make = partial(Sweep, {name: table[key] for name, key in lists.items()})
    check_keys(make, "[sweep]", own, tuple(listed().values()))
    check_key_types(Sweep, "[sweep]", own)
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
    tolerances, seconds : list of float
        In place of spacings, or beside them: errors that are asked for, as shares of the solution's range, the largest
        first; and times, the shortest first. Of methods whose form ``cpm`` is or that name one.
    cheap : list of float
        The spacings of ``--cheap``: those of tests and first looks. Unless given, all but the finest; it leaves the
        last of tolerances and of seconds out, too.
    origins : int
        At how many random positions of the lattice each run is made; 1 is the lattice's own position.
    methods : list of str
        ``cpm``, another of :func:`closest_points`, ``nearest``, ``ball``, ``fem-refined``, or a
        plugin's back end.
    step_per_spacing : float, optional
        For problems with a time step: the longest one, as a multiple of the spacing.
    """

    lists: Mapping[str, list[Any]]
    spacings: list[float] | None = None
    cheap: list[float] | None = None
    origins: int = 1
    methods: tuple[str, ...] | list[str] = ("cpm",)
    step_per_spacing: float | None = None
    tolerances: list[float] | None = None
    seconds: list[float] | None = None

    def __post_init__(self) -> None:
        own = {key: getattr(self, key) for key in (*FINENESS, "cheap", "methods")}
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
        removed = [method for method in self.methods if method in REMOVED_METHODS]
        if removed:
            raise SceneError(f"there is no method {removed[0]!r} of [sweep] any more; use 'galerkin'.")
        self._check_fineness()
        most = max(sum(len(values) for _, values in self._fineness()), len(self.cheap or []))
        count = most * prod(len(one) for one in (*self.lists.values(), self.methods)) * self.origins
        if count > MOST_RUNS:
            raise SceneError(f"[sweep] makes {count} runs, at most {MOST_RUNS} are accepted; leave some values out.")
        try:
            for value in [*(self.spacings or []), *(self.cheap or [])]:
                positive(value, "each spacing of [sweep]")
            for name, values in self._fineness():
                if name in ASKED:
                    for value in values:
                        declared_options(AccuracyTarget)[name].check(value, f"each entry of {ASKED[name]} of [sweep]")
            if self.step_per_spacing is not None:
                positive(self.step_per_spacing, "step_per_spacing of [sweep]")
            for name, values in self.lists.items():
                for value in values:
                    declared_options(FORMS[LISTED_FORM])[name].check(value, f"{listed()[name]} of [sweep]")
            for together in product(*self.lists.values()):
                FORMS[LISTED_FORM](**dict(zip(self.lists, together, strict=True)))
        except InputError as error:
            raise SceneError(str(error)) from error

    def _check_fineness(self) -> None:
        """Refuse a sweep that says nowhere how fine solutions are to be, or says it so that a method cannot take it."""
        if not self._fineness():
            raise SceneError(f"[sweep] needs a list of {', '.join(FINENESS[:-1])} or {FINENESS[-1]}.")
        if self.spacings is None:
            others = [method for method in self.methods if method not in closest_points()]
            given = {"cheap": self.cheap, "step_per_spacing": self.step_per_spacing}
            others += [key for key, value in given.items() if value is not None]
            if others:
                raise SceneError(f"{others[0]!r} of [sweep] goes with spacings alone; give spacings, or leave it out.")
        elif self.step_per_spacing is not None and len(self._fineness()) > 1:
            raise SceneError(
                "step_per_spacing of [sweep] ties the step to a spacing, and tolerances or seconds find their own; "
                "leave one of them out."
            )

    def _fineness(self, cheap: bool = False) -> list[tuple[str, list[float]]]:
        """Return the lists that say how fine solutions are to be, each with what its entries are called."""
        spacings = self.cheap if cheap and self.cheap else self.spacings
        lists = {"spacing": spacings} | {name: getattr(self, key) for name, key in ASKED.items()}
        kept = {name: values for name, values in lists.items() if values}
        if cheap:
            kept |= {name: one[:-1] or one for name, one in kept.items() if name != "spacing" or self.cheap is None}
        return list(kept.items())

    def runs(self, cheap: bool = False) -> list[Run]:
        """Return the runs, the coarsest spacing, the largest tolerance, the shortest time first; none twice."""
        every = (
            Run(method, value if name == "spacing" else None, options, origin, **_asked(name, value))
            for name, values in self._fineness(cheap)
            for value in map(float, values)
            for method in self.methods
            if name == "spacing" or method in closest_points()
            for options, origin in self._discretizations(method)
        )
        return list(dict.fromkeys(every))

    def _discretizations(self, method: str) -> Iterator[tuple[tuple[tuple[str, Any], ...], int | None]]:
        """Yield options and number of the origin, None where a method has none."""
        names, own = listed_of(method), _form_of(method)
        taken = [
            [one for one in self.lists.get(name, ()) if declared_options(own)[name].accepts(one)] for name in names
        ]
        lists = [values or [getattr(own, name)] for name, values in zip(names, taken, strict=True)]
        placed = names or method in closest_points()
        origins = range(self.origins) if self.origins > 1 and placed else [None]
        for values in product(*lists):
            yield from product([tuple(zip(names, values, strict=True))], origins)


def _asked(name: str, value: float) -> dict[str, float]:
    return {f"asked_{name}": value} if name in ASKED else {}


@dataclass(frozen=True)
class Run:
    """One solve of a study.

    Attributes
    ----------
    method : str
        One of :func:`closest_points`, a baseline or a back end.
    spacing : float or None
        Of the lattice; of a back end whatever it makes of it. None where something else is asked for.
    options : tuple of (str, value)
        Those that the method has of the options whose values a study lists.
    origin : int or None
        Number of the lattice's random position; None: its own.
    asked_tolerance, asked_seconds : float or None
        What is asked for in place of a spacing.
    """

    method: str
    spacing: float | None
    options: tuple[tuple[str, Any], ...]
    origin: int | None
    asked_tolerance: float | None = None
    asked_seconds: float | None = None

    @classmethod
    def of(cls, record: Mapping[str, Any]) -> Run:
        """Return the run of a record; an option that it does not know yet had its default."""
        names = listed_of(record["method"])
        own = _form_of(record["method"])
        options = tuple((name, record.get(name, getattr(own, name))) for name in names)
        target = {key: record.get(key) for key in ASKED_ENTRIES}
        spacing = record["spacing"] if set(target.values()) == {None} else None  # else it is the one that was found
        return cls(record["method"], spacing, options, record["origin"], **target)

    @property
    def target(self) -> dict[str, float]:
        """What is asked for in place of a spacing, as keyword arguments of ``solve``."""
        found = {name: getattr(self, f"asked_{name}") for name in ASKED}
        return {name: value for name, value in found.items() if value is not None}

    def as_dict(self) -> dict[str, Any]:
        """Return the parameters as plain values, None where the method has no such option."""
        options = dict.fromkeys(listed()) | dict(self.options)
        target = {key: getattr(self, key) for key in ASKED_ENTRIES}
        return {"method": self.method, "spacing": self.spacing, **target, **options, "origin": self.origin}

    def shift(self, dim: int, unit: float | None = None) -> Floats:
        """Return by how much (d,) the lattice is moved: uniformly distributed between 0 and a spacing, or ``unit``."""
        if self.origin is None:
            return np.zeros(dim)
        positions = np.random.default_rng(ORIGINS_SEED).uniform(0, 1, (self.origin + 1, dim))
        return np.asarray((self.spacing if unit is None else unit) * positions[self.origin])
