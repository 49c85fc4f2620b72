"""The error raised where memory runs out although the estimate fitted."""

from __future__ import annotations

import traceback
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any, NamedTuple

import numpy as np

from cpmkit.errors import ResolutionError
from cpmkit.forecast.needs import bytes_needed, solver_for
from cpmkit.forms.galerkin import galerkin_cost as galerkin
from cpmkit.forms.galerkin.options import GalerkinOptions
from cpmkit.forms.options import Options
from cpmkit.grid.fitting import fitting_spacing, other_solver_hint, rounded_up, unknowns_at_one
from cpmkit.manifold.local_source import LocalSource, localize
from cpmkit.runtime import memory
from cpmkit.scene.scene import Scene

#: Where memory ran out although a spacing seemed to fit, one this many times as large is named.
COARSER_SPACING_FACTOR = 1.5


class _Need(NamedTuple):
    """What a solve needs: unknowns, a solver, bytes; the spacing that fits, and another solver that needs less."""

    unknowns: float
    solver: str
    size: float
    fits: float
    hint: str


@contextmanager
def explain_memory_error(scene: Scene, options: Options[Any] | None = None, solver: str = "auto") -> Iterator[None]:
    """Where memory runs out inside, say what is needed, what there was, and a spacing that would fit.

    The tables that the error's traceback holds are let go first. The ``options`` are None for another back end.

    Raises
    ------
    ResolutionError
        In place of the error.
    """
    limit = memory.memory_limit()
    try:
        yield
    except Exception as error:
        if not memory.is_out_of_memory(error):
            raise
        traceback.clear_frames(error.__traceback__)
        raise ResolutionError(_sentence(scene, options, solver, limit)) from error


def _sentence(scene: Scene, options: Options[Any] | None, solver: str, limit: memory.MemoryLimit) -> str:
    if options is None:
        return f"Memory ran out, and {limit}; a coarser mesh, or a larger spacing, needs less."
    spacing, needed, hint, fits = options.spacing, "", "", 0.0
    with suppress(MemoryError, ValueError, ArithmeticError):
        source = localize(scene.surface, np.zeros(scene.surface.dim))
        need = _of_galerkin if isinstance(options.own, GalerkinOptions) else _of_collocation
        unknowns, solver, size, fits, hint = need(scene, source, options, solver, limit.bytes)
        needed = f"about {unknowns:.2g} unknowns need {size / 2**30:.2g} GiB or more with the solver {solver!r}, and "
    fits = max(fits, rounded_up(COARSER_SPACING_FACTOR * spacing))
    return (
        f"Memory ran out at spacing={spacing:g}: {needed}{limit}, libraries included; "
        f"try spacing={fits:g} or more{hint}."
    )


def _of_collocation(scene: Scene, source: LocalSource, options: Options[Any], solver: str, available: int) -> _Need:
    degree = options.own.degree
    unknowns = unknowns_at_one(source, degree) / options.spacing**source.largest_dim
    solver = solver_for(scene, options, solver, unknowns)
    size = bytes_needed(scene, options, solver, unknowns)
    return _Need(unknowns, solver, size, fitting_spacing(source, degree, available, solver), other_solver_hint(solver))


def _of_galerkin(scene: Scene, source: LocalSource, options: Options[Any], solver: str, available: int) -> _Need:
    unknowns = galerkin.expected_unknowns(source, options.spacing, options.own.degree)
    solver = solver_for(scene, options, solver, unknowns)
    size = bytes_needed(scene, options, solver, unknowns)
    fits = galerkin.fitting_spacing(source, available, galerkin.factorised_share(scene, solver), options.own.degree)
    return _Need(unknowns, solver, size, fits, other_solver_hint(solver, "multigrid"))
