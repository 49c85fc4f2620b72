"""Work in units that no clock and no other process disturbs: calls of functions, Python's and compiled ones."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any


def counted_calls(function: Callable[[], Any], name: str = "") -> int:
    """Return how many functions, or Python functions of one name, are called while ``function`` runs in this thread."""
    count = 0

    def count_call(frame: Any, event: str, argument: Any) -> None:
        nonlocal count
        count += frame.f_code.co_name == name and event == "call" if name else event in ("call", "c_call")

    before = sys.getprofile()
    sys.setprofile(count_call)
    try:
        function()
    finally:
        sys.setprofile(before)
    return count
