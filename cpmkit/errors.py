"""The errors that cpmkit raises on purpose; a message gives the value received, the values accepted and a remedy."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from cpmkit.linear.residuals import SolveReport


#: Largest number of characters of a given value that a message repeats.
ECHOED_CHARACTERS = 200


class CpmkitError(Exception):
    """Base class of all errors that cpmkit raises on purpose; control characters in the message are escaped."""

    def __init__(self, message: str) -> None:
        super().__init__(printable(message))


class CpmkitWarning(UserWarning):
    """Category of the warnings that come with a solution, for Python's warning filters."""


class InputError(CpmkitError, ValueError):
    """An argument, an array or a file has a value that is not accepted."""


class SceneError(InputError):
    """A scene, or the file that describes it, is incomplete or contradicts itself."""


class PluginError(CpmkitError, LookupError):
    """No installed plugin offers a kind that a scene names, or the plugin is broken."""


class ResolutionError(CpmkitError, ValueError):
    """The spacing does not suit the scene or the machine; the message gives one that does."""


class MissingDependencyError(CpmkitError, ImportError):
    """An optional library is missing or cannot be loaded; the message gives the command that installs it."""


class ConvergenceError(CpmkitError, ArithmeticError):
    """A solver did not reach its tolerance; ``report`` contains the residual that it reached."""

    def __init__(self, message: str, report: SolveReport) -> None:
        super().__init__(message)
        self.report = report


def printable(text: str) -> str:
    """Return ``text`` with each non-printable character but the newline as an escape of ASCII."""
    return "".join(letter if letter.isprintable() or letter == "\n" else ascii(letter)[1:-1] for letter in text)


def shown(value: object) -> str:
    """Return a value as text for messages: its repr on one line, cut after 200 characters.

    For an array, a column or a table of more than 12 entries the text gives the type and the shape; for a value whose
    repr fails, the type.

    Examples
    --------
    >>> shown("abc"), len(shown("x" * 1000))
    ("'abc'", 203)
    >>> import numpy as np
    >>> shown(np.zeros((5, 3)))
    'ndarray of shape (5, 3)'
    """
    shape = getattr(value, "shape", None)
    if isinstance(shape, tuple) and all(isinstance(size, int) for size in shape) and math.prod(shape) > 12:
        return f"{type(value).__name__} of shape {shape}"
    try:
        text = repr(value)
        text = text if isinstance(value, str) else " ".join(text.split())
    except (ValueError, RecursionError):  # an integer of thousands of digits, tables inside tables
        text = f"a {type(value).__name__}"
    return printable(text if len(text) <= ECHOED_CHARACTERS else text[:ECHOED_CHARACTERS] + "...")


def place(point: Iterable[float]) -> str:
    """Return a point as text for messages, with all coordinates to the fourth digit of the largest.

    Examples
    --------
    >>> place([1.0052, 7.1e-06]), place([100.0, 100.5, 0.25])
    ('(1.005, 0)', '(100, 100.5, 0.2)')
    """
    numbers = [float(x) for x in point]
    largest = max(map(abs, numbers), default=0.0)
    if not 0.0 < largest < math.inf:
        return f"({', '.join(f'{x:g}' for x in numbers)})"
    digits = 3 - math.floor(math.log10(largest))
    return f"({', '.join(f'{round(x, digits) + 0.0:.4g}' for x in numbers)})"
