"""Options of a discretisation, and targets that users give in place of a spacing: an error, a time, a memory."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Generic, TypeVar

from cpmkit.errors import InputError, shown
from cpmkit.forms.contract import Discretized
from cpmkit.linear.solver_options import choose_solver
from cpmkit.manifold.local_source import largest_dim
from cpmkit.runtime.arrays import positive
from cpmkit.runtime.options import OPTION_KEY, DeclaredOptions, Option, one_of, option

Own = TypeVar("Own", bound=DeclaredOptions)
AUTO = "auto"  #: The value of the option ``form`` that chooses the form that fits the scene.


@dataclass(frozen=True, eq=False)
class Options(DeclaredOptions, Generic[Own]):
    """How a scene is discretised: ``own`` are the options of the form, ``reason`` says why that form was chosen."""

    spacing: float = field(
        metadata={
            OPTION_KEY: Option("Distance of neighbouring lattice nodes, in the scene's unit of length.", positive)
        }
    )
    own: Own
    origin: Any = option(None, "Position of a lattice node, (d,); by default the centre of the surface's bounds.")
    form: str = option(
        AUTO,
        "How the equation is discretised on the lattice: ``collocation``, the closest point method, ``galerkin``, "
        "splines with the energy integrated over the manifold, or ``auto``, which takes the one that fits the scene.",
        methods={"collocation": "collocation", "galerkin": "galerkin"},
    )
    reason: str = ""

    def as_dict(self) -> dict[str, Any]:
        """Return the values of all options, those of the form included, by their names."""
        return {**super().as_dict(), **self.own.as_dict()}


def solver_of(form: Discretized, target: str) -> str:
    """Return the name of the solver that ``target`` ("auto" or a name) means for a discretised scene."""
    problem, traits = form.scene.problem, form.traits
    factor = problem.direct_solver_limit(traits.iterative_solver == "multigrid") * traits.factorise_up_to
    return choose_solver(target, form.size, largest_dim(form.scene.surface), factor, traits.iterative_solver)


def lattice_options(form: Discretized) -> Options[Any] | None:
    """Return the options with which a scene was discretised on a lattice; None if the form has no lattice."""
    options = getattr(form, "options", None)
    return options if isinstance(options, Options) else None


#: Bytes of the units in which a memory may be written.
MEMORY_UNITS = {"kib": 2**10, "mib": 2**20, "gib": 2**30, "kb": 10**3, "mb": 10**6, "gb": 10**9}


def _positive_or_none(value: Any, label: str) -> float | None:
    """Return ``value``, called ``label`` in errors, as float if it is positive, or None; else raise an InputError."""
    return None if value is None else positive(value, label)


def _check_tolerance(value: Any, label: str) -> float | None:
    """Return ``value``, called ``label`` in errors, as float if in (0, 1), or None; else raise an InputError."""
    if value is not None and positive(value, label) >= 1:
        raise InputError(
            f"{label} is an error as a share of the solution's range and must be below 1, got {value:g}; use 1e-3."
        )
    return None if value is None else float(value)


def _check_estimate(value: Any, label: str) -> Any:
    """Return ``value``, called ``label`` in errors, if it is a bool, "tight" or None; else raise an InputError."""
    if value is not None and not isinstance(value, bool) and value != "tight":
        raise InputError(f"{label} must be True, False, 'tight' or None, got {shown(value)}.")
    return value


def read_memory(value: Any, label: str = "memory") -> float | None:
    """Return a memory in bytes, given as a number or as text such as ``"2 GiB"``; None is returned unchanged.

    Raises InputError, naming the value ``label``, if the number is not positive, or the text not a number and a unit.
    """
    if not isinstance(value, str):
        return _positive_or_none(value, label)
    text = value.strip().lower()
    for unit, size in MEMORY_UNITS.items():
        if text.endswith(unit):
            try:
                return positive(float(text[: -len(unit)]), label) * size
            except ValueError:
                break
    raise InputError(f"{label} must be a number of bytes, or text such as '2 GiB' or '500 MB', got {shown(value)}.")


@dataclass(frozen=True)
class AccuracyTarget(DeclaredOptions):
    """The error that a solution must reach, or the time and memory that it may take.

    Raises InputError if a value is not accepted.
    """

    tolerance: float | None = option(
        None,
        "In place of a spacing: the largest error that the solution may have, as a share of its range; of eigenvalues, "
        "of each. The solves that led to the solution are in ``solution.solve_history``.",
        _check_tolerance,
    )
    norm: str = option(
        "rms",
        "Norm of ``tolerance``: ``rms``, the root mean square, or ``max``, the largest error.",
        one_of("rms", "max"),
    )
    seconds: float | None = option(
        None,
        "In place of a spacing: the seconds that all solves may take on this machine; the finest solution that this "
        "allows is returned. With ``tolerance`` a limit.",
        _positive_or_none,
    )
    memory: float | None = option(
        None,
        "In place of a spacing: bytes, or text such as ``'2 GiB'``; the finest solution that this allows is returned. "
        "With ``tolerance`` or ``seconds`` a limit.",
        read_memory,
    )

    estimate: Any = option(
        None,
        "Whether the error is estimated at once by a solve at twice the spacing (``True``), with a further one at the "
        "root of two times the spacing (``'tight'``), never (``False``), or when ``solution.error`` is first read "
        "(``None``).",
        _check_estimate,
    )

    @property
    def given_targets(self) -> list[str]:
        """Names of the targets that are given: tolerance, seconds, memory."""
        return [name for name in ("tolerance", "seconds", "memory") if getattr(self, name) is not None]

    @property
    def target(self) -> str:
        """The targets that are given, as ``name=value``, joined by ``and``; the memory is in bytes."""
        return " and ".join(f"{name}={getattr(self, name):g}" for name in self.given_targets)

    def check_spacing(self, spacing: float | None) -> None:
        """Raise InputError for a ``spacing`` (None: not given) beside a target, or norm="max" without a target."""
        if self.given_targets and spacing is not None:
            name = self.given_targets[0]
            raise InputError(
                f"got spacing={spacing:g} and {name}={getattr(self, name):g}, and each decides how fine the lattice "
                "is; give one of them. The residual of linear systems is solver_tolerance."
            )
        if not self.given_targets and self.norm != "rms":
            raise InputError(f"norm={self.norm!r} says how tolerance is meant, and there is none; give tolerance.")
