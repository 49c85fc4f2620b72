"""Work in units that no clock and no other process disturbs: calls of functions, Python's and compiled ones."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any


def counted_calls(function: Callable[[], Any]) -> int:
    """Return how many functions are called while ``function`` runs in this thread, whatever it raises left alone."""
    count = 0

    def count_call(frame: Any, event: str, argument: Any) -> None:
        nonlocal count
        count += event in ("call", "c_call")

    before = sys.getprofile()
    sys.setprofile(count_call)
    try:
        function()
    finally:
        sys.setprofile(before)
    return count
