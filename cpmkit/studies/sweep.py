"""The sweep of a study: the options that it varies, and the resulting runs."""

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
from cpmkit.forms.options import AccuracyTarget
from cpmkit.plugins import call_factory, check_keys
from cpmkit.runtime.arrays import positive
from cpmkit.runtime.options import check_key_types, declared_options
from cpmkit.types import Floats

#: Baseline methods, which fix nodes, and their options.
BASELINES = {"nearest": ("degree",), "ball": ("degree",)}
#: The method that is the back end ``fem`` on a refined mesh.
REFINED = "fem-refined"
#: The form of the method ``cpm``, the paper's; a study lists values of its options.
LISTED_FORM = "collocation"
#: Accuracy targets in place of a spacing, each with the key of its list; then the keys of all lists of resolutions.
TARGETS = {"tolerance": "tolerances", "seconds": "seconds"}
FINENESS = ("spacings", *TARGETS.values())


def lattice_methods() -> dict[str, dict[str, Any]]:
    """Return the methods on a lattice, each with the options of ``solve`` that it sets; ``cpm`` sets only the form."""
    options = every_option().items()
    return {"cpm": {"form": LISTED_FORM}} | {
        method: {name: value} for name, entry in options for method, value in entry.methods.items()
    }


def listed_options() -> dict[str, str]:
    """Return the options of LISTED_FORM of which a study may list values, each with its key in [sweep]."""
    return {
        name: entry.plural or f"{name}s"
        for name, entry in declared_options(FORMS[LISTED_FORM]).items()
        if not entry.methods
    }


def listed_options_of(method: str) -> tuple[str, ...]:
    """Return the options of ``method`` of which a study may list values."""
    if method not in lattice_methods():
        return BASELINES.get(method, ())
    return tuple(name for name in listed_options() if name in declared_options(_form_options_of(method)))


def _form_options_of(method: str) -> Any:
    """Return the class of the options of the form that ``method`` sets, or of LISTED_FORM if it sets none."""
    return FORMS[lattice_methods().get(method, {}).get("form", LISTED_FORM)]


def read_sweep(table: Mapping[str, Any]) -> Sweep:
    """Return the sweep that the ``table`` [sweep] describes; raise SceneError if a key or value is not accepted."""
    lists = {name: key for name, key in listed_options().items() if key in table}
    own = {key: value for key, value in table.items() if key not in lists.values()}
    make = partial(Sweep, {name: table[key] for name, key in lists.items()})
    check_keys(make, "[sweep]", own, tuple(listed_options().values()))
    check_key_types(Sweep, "[sweep]", own)
    return call_factory(make, "[sweep]", own)


@dataclass(frozen=True, eq=False)
class Sweep:
    """The options that a study varies."""

    lists: Mapping[str, list[Any]]  #: Values of options by name; an option that is not named has its default.
    spacings: list[float] | None = None  #: Spacings of the lattice, in the scene's unit.
    #: The spacings of ``--cheap``, for tests; by default all but the finest. The last tolerance and the last time are
    #: left out, too.
    cheap: list[float] | None = None
    origins: int = 1  #: Number of random positions of the lattice for each run; 1 is the lattice's own position.
    #: ``cpm``, another of :func:`lattice_methods`, ``nearest``, ``ball``, ``fem-refined``, or a plugin's back end.
    methods: tuple[str, ...] | list[str] = ("cpm",)
    #: For problems with a time step: the longest step, as a multiple of the spacing.
    step_per_spacing: float | None = None
    #: tolerances, seconds: In place of spacings or with them: target errors as shares of the solution's range, the
    #: largest first; and target times, the shortest first. Only for methods on a lattice.
    tolerances: list[float] | None = None
    seconds: list[float] | None = None

    def __post_init__(self) -> None:
        """Check the entries of [sweep], and the number of runs; raise SceneError if one is not accepted."""
        own = {key: getattr(self, key) for key in (*FINENESS, "cheap", "methods")}
        for key, value in {**own, **{listed_options()[name]: values for name, values in self.lists.items()}}.items():
            if value is not None and (not isinstance(value, (list, tuple)) or not value):
                raise SceneError(f"{key} of [sweep] must be a list with at least one entry, got {shown(value)}.")
        if type(self.origins) is not int or not 0 < self.origins <= 10_000:
            raise SceneError(
                f"origins of [sweep] must be a whole number above zero, 10000 at most, got {shown(self.origins)}."
            )
        wrong_methods = [method for method in self.methods if not isinstance(method, str)]
        if wrong_methods:
            raise SceneError(f"methods of [sweep] must be names such as 'cpm', got {shown(wrong_methods[0])}.")
        removed = [method for method in self.methods if method in ("balanced", "unfolded")]
        if removed:
            raise SceneError(f"there is no method {removed[0]!r} of [sweep] any more; use 'galerkin'.")
        self._check_resolutions()
        most = max(sum(len(values) for _, values in self._resolutions()), len(self.cheap or []))
        count = most * prod(len(entry) for entry in (*self.lists.values(), self.methods)) * self.origins
        if count > 100_000:
            raise SceneError(f"[sweep] makes {count} runs, at most 100000 are accepted; leave some values out.")
        try:
            for value in [*(self.spacings or []), *(self.cheap or [])]:
                positive(value, "each spacing of [sweep]")
            if self.step_per_spacing is not None:
                positive(self.step_per_spacing, "step_per_spacing of [sweep]")
            targets = {name: values for name, values in self._resolutions() if name in TARGETS}
            for options, lists in ((AccuracyTarget, targets), (FORMS[LISTED_FORM], self.lists)):
                for name, values in lists.items():
                    label = f"each entry of {TARGETS[name]}" if name in TARGETS else listed_options()[name]
                    for value in values:
                        declared_options(options)[name].check(value, f"{label} of [sweep]")
            for together in product(*self.lists.values()):
                FORMS[LISTED_FORM](**dict(zip(self.lists, together, strict=True)))
        except InputError as error:
            raise SceneError(str(error)) from error

    def _check_resolutions(self) -> None:
        """Raise SceneError without spacings and targets, or if methods, cheap or step_per_spacing do not fit them."""
        if not self._resolutions():
            raise SceneError(f"[sweep] needs a list of {', '.join(FINENESS[:-1])} or {FINENESS[-1]}.")
        if self.spacings is None:
            others = [method for method in self.methods if method not in lattice_methods()]
            given = {"cheap": self.cheap, "step_per_spacing": self.step_per_spacing}
            others += [key for key, value in given.items() if value is not None]
            if others:
                raise SceneError(f"{others[0]!r} of [sweep] goes with spacings alone; give spacings, or leave it out.")
        elif self.step_per_spacing is not None and len(self._resolutions()) > 1:
            raise SceneError(
                "step_per_spacing of [sweep] ties the step to a spacing, and tolerances or seconds find their own; "
                "leave one of them out."
            )

    def _resolutions(self, cheap: bool = False) -> list[tuple[str, list[float]]]:
        """Return the lists of spacings and targets that are given, each as (name of an entry, values).

        If ``cheap``, spacings are replaced by :attr:`cheap` where that is given; every other list lacks its last entry,
        the finest, unless it is the only one.
        """
        spacings = self.cheap if cheap and self.cheap else self.spacings
        lists = {"spacing": spacings} | {name: getattr(self, key) for name, key in TARGETS.items()}
        present = {name: values for name, values in lists.items() if values}
        if cheap:
            shortened = {name: values[:-1] or values for name, values in present.items()}
            present |= {name: values for name, values in shortened.items() if name != "spacing" or self.cheap is None}
        return list(present.items())

    def runs(self, cheap: bool = False) -> list[Run]:
        """Return the runs in the order of the lists, each once, of the cheap lists if ``cheap``."""
        every = (
            Run(method, value if name == "spacing" else None, options, origin, ((name, value),) * (name in TARGETS))
            for name, values in self._resolutions(cheap)
            for value in map(float, values)
            for method in self.methods
            if name == "spacing" or method in lattice_methods()
            for options, origin in self._discretizations(method)
        )
        return list(dict.fromkeys(every))

    def _discretizations(self, method: str) -> Iterator[tuple[tuple[tuple[str, Any], ...], int | None]]:
        """Yield pairs (options as (name, value), number of the lattice position or None) of the runs at one resolution.

        Each option takes the listed values that the method's form accepts, or its default if there are none.
        """
        names, form = listed_options_of(method), _form_options_of(method)
        checks = declared_options(form)
        accepted = [[value for value in self.lists.get(name, ()) if checks[name].accepts(value)] for name in names]
        lists = [values or [getattr(form, name)] for name, values in zip(names, accepted, strict=True)]
        placed = names or method in lattice_methods()
        origins = range(self.origins) if self.origins > 1 and placed else [None]
        for values in product(*lists):
            yield from product([tuple(zip(names, values, strict=True))], origins)


@dataclass(frozen=True)
class Run:
    """One solve of a study."""

    method: str  #: One of :func:`lattice_methods`, a baseline or a back end.
    spacing: float | None  #: Spacing of the lattice, or the argument of a back end; None with an accuracy target.
    options: tuple[tuple[str, Any], ...]  #: tuple of (str, value): values of the method's options that a study varies.
    origin: int | None  #: Number of the lattice's random position; None for its default position.
    #: tuple of (str, float): accuracy target in place of a spacing: its name and value.
    targets: tuple[tuple[str, float], ...] = ()

    @classmethod
    def from_record(cls, record: Mapping[str, Any]) -> Run:
        """Return the run of a record; options that an older record lacks have their defaults."""
        names, form = listed_options_of(record["method"]), _form_options_of(record["method"])
        options = tuple((name, record.get(name, getattr(form, name))) for name in names)
        values: dict[str, Any] = {name: record.get(f"asked_{name}") for name in TARGETS}
        targets = [(name, value) for name, value in values.items() if value is not None]
        spacing = None if targets else record["spacing"]  # with a target the spacing is a result
        return cls(record["method"], spacing, options, record["origin"], tuple(targets))

    @property
    def target(self) -> dict[str, float]:
        """The accuracy target in place of a spacing, as keyword arguments of ``solve``."""
        return dict(self.targets)

    def as_dict(self) -> dict[str, Any]:
        """Return the run's entries of a record, plain values by name; None for those that it does not have."""
        options = dict.fromkeys(listed_options()) | dict(self.options)
        target = {f"asked_{name}": self.target.get(name) for name in TARGETS}
        return {"method": self.method, "spacing": self.spacing, **target, **options, "origin": self.origin}

    def lattice_shift(self, dim: int, unit: float | None = None) -> Floats:
        """Return the shift (``dim``,) of the lattice: random in [0, ``unit`` or spacing), zero without an origin."""
        if self.origin is None:
            return np.zeros(dim)
        positions = np.random.default_rng(1).uniform(0, 1, (self.origin + 1, dim))
        return np.asarray((self.spacing if unit is None else unit) * positions[self.origin])
