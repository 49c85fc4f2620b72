"""A scanner of the numbers, flags and words of an SVG attribute."""

from __future__ import annotations

import re

from cpmkit.plugin import InputError, shown

NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")
SEPARATORS = re.compile(r"[\s,]*")
FLAG = re.compile(r"[01]")
LETTER = re.compile(r"[A-Za-z]")
#: The largest number of single precision, which SVG numbers have.
LARGEST_NUMBER = 3.4e38


class Scanner:
    """A text with a reading position; ``label`` names the attribute in messages."""

    def __init__(self, text: str, label: str) -> None:
        self.words, self.label, self.place = text, label, 0

    def match(self, pattern: re.Pattern[str]) -> str:
        """Move past separators; return the text there that matches the pattern and move past it, else an empty text."""
        self.place = SEPARATORS.match(self.words, self.place).end()  # type: ignore[union-attr]
        match = pattern.match(self.words, self.place)
        if match is None:
            return ""
        self.place = match.end()
        return match.group()

    def numbers(self, count: int) -> list[float]:
        """Return the next ``count`` numbers and move past them; raise InputError if there are fewer."""
        return [self._number() for _ in range(count)]

    def flag(self) -> bool:
        """Return whether the next flag is 1, not 0; no separator need follow it. Raise InputError if there is none."""
        return self._expect(FLAG, "a flag, 0 or 1,") == "1"

    def number_follows(self) -> bool:
        """Return whether a number follows; the position stays."""
        before = self.place
        matches = bool(self.match(NUMBER))
        self.place = before
        return matches

    @property
    def at_end(self) -> bool:
        """Whether the end of the text is reached."""
        self.match(SEPARATORS)
        return self.place == len(self.words)

    def syntax_error(self, expected: str) -> InputError:
        """Return, not raise, an InputError: ``expected`` was expected where the text at the position stands."""
        rest = self.words[self.place : self.place + 20]
        got = shown(rest) if rest else "its end"
        return InputError(f"{self.label}: {expected} was expected at character {self.place + 1}, got {got}.")

    def _number(self) -> float:
        """Return the next number and move past it; raise InputError if none follows, or it exceeds single precision."""
        before = self.place
        number = float(self._expect(NUMBER, "a number"))
        if abs(number) > LARGEST_NUMBER:
            self.place = before
            raise self.syntax_error(f"a number of at most {LARGEST_NUMBER:g}")
        return number

    def _expect(self, pattern: re.Pattern[str], expected: str) -> str:
        """Return the text that matches ``pattern`` and move past it, else raise InputError, naming ``expected``."""
        text = self.match(pattern)
        if not text:
            raise self.syntax_error(expected)
        return text
