"""Every kind of source that is installed keeps every law, on at least one case."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from cpmkit.testing import ConformanceCase, installed_cases, kinds_without_case, parametrize_with_laws

#: Laws that ask each case many queries of their own: beyond the first case of a kind they are slow.
DEAR_LAWS = ("check_lipschitz", "check_batches")


def _members() -> list[Any]:
    """Return the members that ``parametrize_with_laws`` makes, with the slow ones marked."""
    cases = installed_cases()
    first = {case.kind: case.name for case in reversed(cases)}
    members = []
    for member in parametrize_with_laws(cases).args[1]:
        case, law = member.values
        slow = law.__name__ in DEAR_LAWS and case.name != first[case.kind]
        members.append(pytest.param(case, law, id=member.id, marks=[pytest.mark.slow] * slow))
    return members


@pytest.mark.parametrize(("case", "law"), _members())
def test_installed_kinds_keep_the_laws(case: ConformanceCase, law: Callable[[ConformanceCase], None]) -> None:
    law(case)


def test_every_installed_kind_has_a_case() -> None:
    assert kinds_without_case() == []
