"""Every error that cpmkit raises on purpose: one sentence with what was got, what is accepted, what to do."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from cpmkit.solvers.report import SolveReport


class CpmkitError(Exception):
    """Base of all errors that cpmkit raises on purpose."""


class InputError(CpmkitError, ValueError):
    """An argument, an array or a file does not hold what is accepted."""


class SceneError(InputError):
    """A scene, or the file that describes it, is incomplete or contradicts itself."""


class PluginError(CpmkitError, LookupError):
    """A kind that a scene names is offered by no installed plugin, or its plugin is broken."""


class ResolutionError(CpmkitError, ValueError):
    """The spacing does not fit the scene or the machine; the message names one that does."""


class MissingDependencyError(CpmkitError, ImportError):
    """An optional library is absent or cannot load; the message names what installs it."""


class ConvergenceError(CpmkitError, ArithmeticError):
    """A solver did not reach its tolerance; ``report`` says what was reached."""

    def __init__(self, message: str, report: SolveReport) -> None:
        super().__init__(message)
        self.report = report
