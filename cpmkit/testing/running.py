"""All laws in one list, and the two ways to run them."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

from cpmkit.testing import ability_laws, foot_laws, form_laws, left_laws, local_minima_laws
from cpmkit.testing.cases import ConformanceCase

#: Every law: called with a case, it returns or raises an AssertionError.
LAWS: tuple[Callable[[ConformanceCase], None], ...] = tuple(
    check
    for module in (form_laws, foot_laws, ability_laws, local_minima_laws, left_laws)
    for name, check in vars(module).items()
    if name.startswith("check_")
)


def run_laws(case: ConformanceCase) -> None:
    """Check every law on a case.

    Raises
    ------
    AssertionError
        At the first law that is broken; it names the law, the kind and a query.
    """
    for law in LAWS:
        law(case)


def parametrize_with_laws(cases: Iterable[ConformanceCase]) -> Callable[[Any], Any]:
    """Return a pytest decorator that runs a test once a case and law, as arguments ``case`` and ``law``."""
    import pytest

    pairs = [
        pytest.param(case, law, id=f"{case.kind}-{case.name}-{law.__name__.removeprefix('check_')}")
        for case in cases
        for law in LAWS
    ]
    return pytest.mark.parametrize(("case", "law"), pairs)
