"""Path data of SVG (the attribute d) as chains of cubics."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.plugin import Floats
from cpmkit_svg.arcs import arc_cubics
from cpmkit_svg.scanner import LETTER, Scanner

#: Numbers that each command takes.
COUNTS = {"M": 2, "L": 2, "H": 1, "V": 1, "C": 6, "S": 4, "Q": 4, "T": 2, "A": 7, "Z": 0}


@dataclass(frozen=True, eq=False)
class Subpath:
    """A curve without a break.

    Attributes
    ----------
    cubics : (k, 4, 2) float64
        Control points of one cubic after another; lines and arcs are cubics too.
    closed : bool
        Whether the path data close it.
    """

    cubics: Floats
    closed: bool


def subpaths(text: str, label: str) -> list[Subpath]:
    """Return the subpaths that the path data ``text`` draw, without those of one point.

    Raise InputError if the data are damaged: the message names ``label`` and the place.
    """
    pen, scanner, command = _Pen(), Scanner(text, label), ""
    while not scanner.at_end:
        letter = scanner.match(LETTER)
        if letter:
            if letter.upper() not in COUNTS or not (command or letter in "Mm"):
                raise scanner.syntax_error("a command of path data, the first of them M,")
            command = letter
        elif not command or command in "Zz":
            raise scanner.syntax_error("a command of path data")
        if letter or scanner.number_follows():
            pen.draw(command, _arguments(scanner, command.upper()))
        else:
            raise scanner.syntax_error("a number")
        if command in "Mm":
            command = "L" if command == "M" else "l"  # further points of a move are lines
    pen.end_subpath(closed=False)
    return pen.found


def _arguments(scanner: Scanner, command: str) -> list[float]:
    if command != "A":
        return scanner.numbers(COUNTS[command])
    return [*scanner.numbers(3), float(scanner.flag()), float(scanner.flag()), *scanner.numbers(2)]


class _Pen:
    """The pen's position and the subpaths that it has drawn."""

    def __init__(self) -> None:
        """Put the pen at the origin, with nothing drawn."""
        self.at, self.begin = np.zeros(2), np.zeros(2)
        self.handle, self.handle_of = np.zeros(2), ""  # the last control point, which S and T reflect
        self.cubics: list[Floats] = []
        self.found: list[Subpath] = []

    def draw(self, command: str, given: list[float]) -> None:
        """Draw the path command ``command`` with its numbers ``given``, in their order in the path data.

        It starts at the pen's position. A lower-case command has coordinates relative to that position. A subpath that
        Z closes, or that M ends, is appended to :attr:`found`.
        """
        kind = command.upper()
        origin = self.at if command.islower() else np.zeros(2)
        handle = 2 * self.at - self.handle if self.handle_of == {"S": "C", "T": "Q"}.get(kind) else self.at
        if kind == "Z":
            self.end_subpath(closed=True)
        elif kind == "M":
            self.end_subpath(closed=False)
            self.at = self.begin = origin + given
        elif kind == "A":
            end = origin + given[5:]
            self._add(arc_cubics(self.at, np.array(given[:2]), given[2], bool(given[3]), bool(given[4]), end), end)
        elif kind in "HV":
            end = self.at.copy()
            end["HV".index(kind)] = origin["HV".index(kind)] + given[0]
            self._add([np.linspace(self.at, end, 4)], end)
        else:
            self._draw_curve(kind, origin + np.reshape(given, (-1, 2)), handle)
        self.handle_of = {"S": "C", "T": "Q"}.get(kind, kind)

    def _draw_curve(self, kind: str, points: Floats, handle: Floats) -> None:
        """Draw a line, or a curve with one or two control points, to the last of ``points`` (k, 2), as one cubic.

        ``kind`` is the command's upper-case letter, L, C, S, Q or T. ``points`` are absolute, with the control points
        first; those of S and T lack the first control point, which is ``handle`` (2,).
        """
        controls = [handle, *points] if kind in "ST" else list(points)
        self.handle = controls[-2] if len(controls) > 1 else controls[-1]
        if len(controls) == 1:
            cubic = np.linspace(self.at, controls[0], 4)
        elif len(controls) == 2:
            cubic = np.stack(
                [self.at, *(point + 2 / 3 * (controls[0] - point) for point in (self.at, controls[1])), controls[1]]
            )
        else:
            cubic = np.stack([self.at, *controls])
        self._add([cubic], controls[-1])

    def _add(self, cubics: list[Floats], end: Floats) -> None:
        """Append ``cubics`` (4, 2), but for those of one point, to the subpath, and move the pen to ``end`` (2,)."""
        self.cubics += [point for point in cubics if (point != point[0]).any()]
        self.at = end

    def end_subpath(self, *, closed: bool) -> None:
        """Append the subpath, if it is not empty, to :attr:`found`; if ``closed``, with a line back to where it began.

        The pen is then where the subpath began.
        """
        if closed and (self.at != self.begin).any():
            self._add([np.linspace(self.at, self.begin, 4)], self.begin)
        if self.cubics:
            self.found.append(Subpath(np.array(self.cubics), closed))
        self.cubics, self.at = [], self.begin
