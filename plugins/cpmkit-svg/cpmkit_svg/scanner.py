"""Numbers, flags and words of SVG attributes, one after the other."""

from __future__ import annotations

import re

from cpmkit.plugin import InputError, shown

NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")
SEPARATORS = re.compile(r"[\s,]*")
FLAG = re.compile(r"[01]")
LETTER = re.compile(r"[A-Za-z]")
#: SVG numbers are of single precision.
LARGEST_NUMBER = 3.4e38


class Scanner:
    """A text that is read from the left."""

    def __init__(self, text: str, what: str) -> None:
        self.words, self.what, self.place = text, what, 0

    def match(self, pattern: re.Pattern[str]) -> str:
        """Return what stands next if it has the pattern, and go past it; else nothing."""
        self.place = SEPARATORS.match(self.words, self.place).end()  # type: ignore[union-attr]
        found = pattern.match(self.words, self.place)
        if found is None:
            return ""
        self.place = found.end()
        return found.group()

    def numbers(self, count: int) -> list[float]:
        """Return the next ``count`` numbers."""
        return [self._number() for _ in range(count)]

    def flag(self) -> bool:
        """Return the next flag, 0 or 1, which nothing needs to part from what follows."""
        return self._needed(FLAG, "a flag, 0 or 1,") == "1"

    def follows_number(self) -> bool:
        """Tell whether a number stands next."""
        before = self.place
        found = bool(self.match(NUMBER))
        self.place = before
        return found

    @property
    def ended(self) -> bool:
        """Whether nothing is left."""
        self.match(SEPARATORS)
        return self.place == len(self.words)

    def refuse(self, expected: str) -> InputError:
        """Return the error that says what stands here instead of what was expected."""
        rest = self.words[self.place : self.place + 20]
        got = shown(rest) if rest else "its end"
        return InputError(f"{self.what}: {expected} was expected at character {self.place + 1}, got {got}.")

    def _number(self) -> float:
        before = self.place
        number = float(self._needed(NUMBER, "a number"))
        if abs(number) > LARGEST_NUMBER:
            self.place = before
            raise self.refuse(f"a number of at most {LARGEST_NUMBER:g}")
        return number

    def _needed(self, pattern: re.Pattern[str], expected: str) -> str:
        found = self.match(pattern)
        if not found:
            raise self.refuse(expected)
        return found
