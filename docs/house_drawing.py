"""Draw rooms as boxes, each above all that it imports."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from itertools import pairwise
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch
from matplotlib.path import Path as Curve

#: A box, the way of an arrow past a floor, and the distance of floors, in the picture's units.
BOX, HEIGHT, WAY, FLOOR = 1.95, 0.42, 0.3, 0.95
#: How far beside the middle of a box dashed arrows begin and end.
ASIDE = 0.45
#: Sweeps over the floors that put rooms in order, beginnings that are tried, and sweeps that move them to their places.
SWEEPS, TRIES, MOVES = 12, 40, 200
INK, GREY, FACE, UPWARDS = "#1b1b1b", "#7a8794", "#eef3f8", "#c4622d"

Pairs = set[tuple[str, str]]


def draw_house(arrows: Pairs, upwards: Pairs, rooms: Iterable[str], file: Path) -> Path:
    """Draw the rooms; an arrow leads from one to another that it imports.

    Arrows that follow from others are left out; those ``upwards`` are drawn dashed.
    """
    kept, floor = reduced(arrows), floors(arrows, rooms)
    ways = {pair: _way(pair, floor) for pair in sorted(kept)}
    ways |= {(*pair, "face"): _way(pair, floor, "face of ") for pair in sorted(upwards)}
    place = _places(ways, floor)
    wide = max(x for x, _ in place.values()) + BOX
    figure = Figure(figsize=(0.72 * wide, 0.72 * (max(floor.values()) + 1) * FLOOR))
    axes = figure.add_axes((0, 0, 1, 1))
    for ends, way in ways.items():
        _arrow(axes, [place[stop] for stop in way], dashed=len(ends) > 2)
    for room in rooms:
        _box(axes, place[room], room)
    axes.set_aspect("equal")
    axes.autoscale_view()
    axes.axis("off")
    figure.savefig(file, dpi=140, bbox_inches="tight", pad_inches=0.02)
    return file


def reduced(arrows: Pairs) -> Pairs:
    """Return the arrows that do not follow from others, of arrows without a cycle."""
    below: dict[str, set[str]] = {}
    for first, second in arrows:
        below.setdefault(first, set()).add(second)

    @cache
    def reached(room: str) -> set[str]:
        return {room}.union(*(reached(other) for other in below.get(room, set())))

    return {
        (first, second)
        for first, second in arrows
        if not any(second in reached(other) for other in below[first] if other != second)
    }


def floors(arrows: Pairs, rooms: Iterable[str]) -> dict[str, int]:
    """Return the floor of each room: one above the highest that it imports; of one that imports none, right below."""
    floor = dict.fromkeys(rooms, 0)
    for _ in floor:
        for first, second in arrows:
            floor[first] = max(floor[first], floor[second] + 1)
    for room in set(floor) - {first for first, _ in arrows}:
        floor[room] = min((floor[first] for first, second in arrows if second == room), default=1) - 1
    return floor


def _way(pair: tuple[str, str], floor: dict[str, int], kind: str = "") -> list[str]:
    """Return the rooms at the ends of an arrow, and between them a place on each floor that it passes, which is added.

    Arrows of a kind that end in one room share their places.
    """
    upper, lower = sorted(pair, key=lambda room: -floor[room])
    between = {f"{kind}{lower} at {level}": level for level in range(floor[upper] - 1, floor[lower], -1)}
    floor.update(between)
    way = [upper, *between, lower]
    return way if upper == pair[0] else way[::-1]


def _places(ways: dict[tuple[str, ...], list[str]], floor: dict[str, int]) -> dict[str, tuple[float, float]]:
    """Return the middles of all boxes and ways: in the order with the fewest crossings, near to their neighbours."""
    downwards = [sorted(way, key=lambda name: -floor[name]) for way in ways.values()]
    links = sorted({(a, b) for way in downwards for a, b in pairwise(way)})
    best = min((_ordered(links, floor, seed) for seed in range(TRIES)), key=lambda order: _crossings(order, links))
    width = {name: WAY if " at " in name else BOX + 0.3 for name in floor}
    x = {name: float(place) for row in best for place, name in enumerate(row)}
    for _ in range(MOVES):
        for row in best:
            wanted = [np.mean([x[other] for other in _beside(name, links)] or [x[name]]) for name in row]
            gaps = np.cumsum([0.0, *((width[a] + width[b]) / 2 for a, b in pairwise(row))])
            x.update(zip(row, _rising(np.array(wanted) - gaps) + gaps, strict=True))
    left = min(x.values())
    return {name: (x[name] - left + BOX / 2, floor[name] * FLOOR) for name in floor}


def _beside(name: str, links: list[tuple[str, str]]) -> list[str]:
    return [b if a == name else a for a, b in links if name in (a, b)]


def _ordered(links: list[tuple[str, str]], floor: dict[str, int], seed: int) -> list[list[str]]:
    """Return the names on each floor, sorted by the mean place of what they are linked to, from a random beginning."""
    shuffled = np.random.default_rng(seed).permutation(sorted(floor))
    rows = [[str(name) for name in shuffled if floor[name] == level] for level in range(max(floor.values()) + 1)]
    best = [list(row) for row in rows]
    for sweep in range(SWEEPS):
        levels = range(1, len(rows)) if sweep % 2 else range(len(rows) - 2, -1, -1)
        for level in levels:
            other = rows[level - 1] if sweep % 2 else rows[level + 1]
            score = {
                name: np.mean([other.index(one) for one in _beside(name, links) if one in other] or [len(other) / 2])
                for name in rows[level]
            }
            rows[level].sort(key=lambda name: float(score[name]))
        if _crossings(rows, links) < _crossings(best, links):
            best = [list(row) for row in rows]
    return best


def _crossings(rows: list[list[str]], links: list[tuple[str, str]]) -> int:
    place = {name: number for row in rows for number, name in enumerate(row)}
    level = {name: number for number, row in enumerate(rows) for name in row}
    above, first, second = np.array([(level[a], place[a], place[b]) for a, b in links]).T
    crossing = np.subtract.outer(first, first) * np.subtract.outer(second, second) < 0
    return int(np.sum(crossing & np.equal.outer(above, above))) // 2


def _rising(values: np.ndarray) -> np.ndarray:
    """Return the nearest values that do not fall (pools of neighbours that would)."""
    pools: list[list[float]] = []
    for value in values:
        pools.append([float(value), 1.0])
        while len(pools) > 1 and pools[-2][0] > pools[-1][0]:
            (a, m), (b, n) = pools[-2:]
            pools[-2:] = [[(a * m + b * n) / (m + n), m + n]]
    return np.concatenate([np.full(int(count), mean) for mean, count in pools])


def _arrow(axes: mpl.axes.Axes, stops: list[tuple[float, float]], dashed: bool = False) -> None:
    """Draw a curve that bends between the floors alone, and goes straight past boxes; a dashed one ends aside."""
    down = 1.0 if stops[0][1] > stops[-1][1] else -1.0
    points = np.repeat(np.array(stops), 2, axis=0)
    points[:, 1] += np.tile([0.5, -0.5], len(stops)) * HEIGHT * down
    points = points[1:-1]
    if dashed:
        points[[0, -1], 0] += ASIDE
    bend = np.array([0.0, 0.5])
    path, codes = [points[0]], [Curve.MOVETO]
    for start, stop in pairwise(points):
        reach = bend * (start[1] - stop[1])
        path += [start - reach, stop + reach, stop]
        codes += [Curve.CURVE4] * 3
    style = {"arrowstyle": "-|>", "mutation_scale": 9, "shrinkA": 0, "shrinkB": 0}
    line = {"lw": 1.3, "ls": (0, (4, 2)), "color": UPWARDS} if dashed else {"lw": 0.9, "color": GREY}
    axes.add_patch(FancyArrowPatch(path=Curve(path, codes), zorder=3 if dashed else 1, **style, **line))


def _box(axes: mpl.axes.Axes, middle: tuple[float, float], room: str) -> None:
    x, y = middle
    corner = (x - BOX / 2, y - HEIGHT / 2)
    style = {"boxstyle": "round,pad=0,rounding_size=0.06", "fc": FACE, "ec": INK, "lw": 0.9}
    axes.add_patch(FancyBboxPatch(corner, BOX, HEIGHT, zorder=2, **style))
    axes.text(x, y - 0.01, room, ha="center", va="center", weight="bold", fontsize=10, color=INK, zorder=4)
