"""Every kind of source that is installed keeps every law, on at least one case."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache, partial

from cpmkit.protocols import ClosestPointSource
from cpmkit.testing import ConformanceCase, installed_cases, kinds_without_case, parametrize_with_laws


@lru_cache(maxsize=1)
def made(make: Callable[[], ClosestPointSource]) -> ClosestPointSource:
    """Return one source for all laws, which follow each other: it is a value, and some take seconds to make."""
    return make()


@parametrize_with_laws(replace(case, make=partial(made, case.make)) for case in installed_cases())
def test_installed_kinds_keep_the_laws(case: ConformanceCase, law: Callable[[ConformanceCase], None]) -> None:
    law(case)


def test_every_installed_kind_has_a_case() -> None:
    assert kinds_without_case() == []
