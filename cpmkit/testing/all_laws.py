"""The list of all laws, and two ways to check them: by a call, and as a parametrised test."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

from cpmkit.testing import ability_laws, answer_laws, local_minima_laws
from cpmkit.testing.cases import ConformanceCase

#: Every law: a function of a case that raises AssertionError where the case breaks it.
LAWS: tuple[Callable[[ConformanceCase], None], ...] = tuple(
    check
    for module in (answer_laws, ability_laws, local_minima_laws)
    for name, check in vars(module).items()
    if name.startswith("check_")
)


def run_laws(case: ConformanceCase) -> None:
    """Check every law on a case.

    Raises
    ------
    AssertionError
        At the first broken law; it names the law, the kind and a query.
    """
    for law in LAWS:
        law(case)


def parametrize_with_laws(cases: Iterable[ConformanceCase]) -> Callable[[Any], Any]:
    """Return a pytest decorator that runs a test for each pair of a case and a law.

    The test has the arguments ``case`` and ``law``.
    """
    import pytest

    pairs = [
        pytest.param(case, law, id=f"{case.kind}-{case.name}-{law.__name__.removeprefix('check_')}")
        for case in cases
        for law in LAWS
    ]
    return pytest.mark.parametrize(("case", "law"), pairs)
