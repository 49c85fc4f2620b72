"""What this distribution hands to cpmkit: the factory of its kind, and examples to check the laws on."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cpmkit.plugin import InputError, hookimpl
from cpmkit_neural.field import read_network
from cpmkit_neural.source import NeuralSurface, neural_surface

if TYPE_CHECKING:
    from cpmkit.plugin import ConformanceCase


def neural_field(*, file: str | Path, bounds: Any = None, resolution: float = 64) -> NeuralSurface:
    """Return the surface on which a trained network is zero; it is negative inside.

    Parameters
    ----------
    file : path
        A NumPy archive: ``weight0``, ``bias0``, ``weight1``, ... and, if they are not given here, ``bounds``.
    bounds : (2, 3) numbers, optional
        The lower and the upper corner of a box that holds the surface.
    resolution : float
        How many cells the lattice has, along the longest side of the bounds, from which samples are taken. A
        part or a gap that is thinner than a cell may be overlooked.

    Raises
    ------
    InputError
        If the file holds no such network, or the bounds do not hold its zero set.
    """
    network, own = read_network(file)
    box = own if bounds is None else bounds
    if box is None:
        raise InputError(f"{file} holds no array bounds; give the key bounds, two corners of a box.")
    return neural_surface(network, box, resolution)


@hookimpl
def cpmkit_sources() -> Mapping[str, Callable[..., NeuralSurface]]:
    """Return the factory of each kind."""
    return {"neural.field": neural_field}


@hookimpl
def cpmkit_conformance_cases() -> "Sequence[ConformanceCase]":
    """Return examples of each kind; imported here because they need the extra ``test``, which solving does not."""
    from cpmkit_neural.cases import conformance_cases

    return conformance_cases()
