"""Renamed public names work under their old name, with a warning that names the new one."""

import sys
import types
from dataclasses import dataclass
from math import pi

import pytest

import cpmkit as ck
from cpmkit.errors import InputError
from cpmkit.runtime.deprecation import DeprecatedMember, deprecated_keywords, deprecated_names


@deprecated_keywords(strength="stabilisation")
def solve(*, stabilisation=0.0, **options):
    return stabilisation, options


@dataclass(frozen=True)
class Part:
    size: int
    was = DeprecatedMember("size")
    doubled = DeprecatedMember("twice")

    def twice(self):
        return 2 * self.size


def test_keywords_of_functions():
    with pytest.warns(DeprecationWarning, match="strength= is now called stabilisation=") as caught:
        assert solve(strength=2.0, degree=1) == (2.0, {"degree": 1})
    assert caught[0].filename == __file__
    with pytest.warns(DeprecationWarning, match="strength"), pytest.raises(InputError, match="given twice"):
        solve(strength=2.0, stabilisation=1.0)


def test_an_old_keyword_that_cpmkit_passes_on_is_reported_where_the_user_wrote_it():
    scene = ck.Scene(ck.source("analytic.circle"), ck.ScreenedPoisson("x"))
    for call in (ck.solve, ck.prepare, ck.explain):
        with pytest.warns(DeprecationWarning, match="strength= is now called") as caught:
            call(scene, 0.2, strength="accurate")
        assert {warning.filename for warning in caught} == {__file__}


def test_members():
    part = Part(3)
    with pytest.warns(DeprecationWarning, match=r"Part\.was is now called Part\.size") as caught:
        assert part.was == 3
    assert caught[0].filename == __file__
    with pytest.warns(DeprecationWarning, match="doubled"):
        assert part.doubled() == 6


def test_names_of_modules(monkeypatch):
    module = types.ModuleType("renaming")
    monkeypatch.setitem(sys.modules, "renaming", module)
    module.__getattr__ = deprecated_names("renaming", {"circumference": "math.pi"}, lambda name: name.upper())
    with pytest.warns(DeprecationWarning, match=r"renaming\.circumference is now called math\.pi"):
        assert module.circumference == pi
    assert module.other == "OTHER"
    module.__getattr__ = deprecated_names("renaming", {})
    with pytest.raises(AttributeError, match="has no attribute 'other'"):
        module.other  # noqa: B018
