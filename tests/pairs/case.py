"""What a scene of a pair is made of, and the exact solution on it.

The manifold is a circle of radius 1, or a disc; features change that. With p the place relative to a part's own centre,
``u = p_x + p_y / 2 + 0.3 p_x p_y``, plus a constant on each part, and 1 more on one side of the boundaries.
"""

from dataclasses import dataclass, field, replace

import numpy as np

#: Where the line runs that cuts a circle in two points, and the trim's.
CUT, TRIM = 0.3, -0.6
#: A circle in a disc, and an open curve.
RING_CENTER, RING_RADIUS = np.array([0.2, -0.2]), 0.3
TIPS = ((-0.5, 0.45), (0.4, 0.6))
#: So much more u is inside the ring, and where p_x is above the cut; and within further boundaries.
JUMP, LIFT = 1.0, -2.0
#: How far beside the others further boundaries are, in spacings; on circles counter-clockwise.
BESIDE = 2.2
RESISTANCE = 0.5
TURN = 0.4
SHIFT = np.array([0.3, -0.2])
ROTATION = np.array([[np.cos(TURN), -np.sin(TURN)], [np.sin(TURN), np.cos(TURN)]])


@dataclass(frozen=True)
class Part:
    """One member of the manifold: a circle, an arc of it, or a disc; ``more`` is added to u."""

    center: tuple[float, float] = (0.0, 0.0)
    radius: float = 1.0
    more: float = 0.0
    cut: bool = True
    arc: tuple[float, float] | None = None


@dataclass(frozen=True)
class Case:
    """A scene of a pair.

    Attributes
    ----------
    solid : bool
        Discs in place of circles.
    parts : tuple of Part
    trimmed, bare, moved, reloaded : bool
        Cut off at ``TRIM``; without abilities; turned and shifted; saved and read back.
    inside : str
        What holds on the boundaries: "sides", different conditions on the two; "transmission"; "nothing".
    tips, crowded : bool
        With an open curve inside; with further boundaries two spacings beside the others.
    edge : str
        "dirichlet" or "robin".
    free : bool
        Neumann conditions alone, and no c.
    heat : bool
        u grows in time, by u each unit of it.
    spacing : float
    options : dict
    """

    solid: bool = False
    parts: tuple[Part, ...] = (Part(),)
    trimmed: bool = False
    bare: bool = False
    moved: bool = False
    reloaded: bool = False
    inside: str = "sides"
    tips: bool = False
    crowded: bool = False
    edge: str = "dirichlet"
    free: bool = False
    heat: bool = False
    spacing: float = 0.05
    options: dict = field(default_factory=dict)

    @property
    def c(self):
        return 0.0 if self.free else 1.0

    def to_local(self, x):
        """Undo the motion."""
        return (x - SHIFT) @ ROTATION if self.moved else x

    def to_world(self, x):
        return x @ ROTATION.T + SHIFT if self.moved else x

    def part_of(self, x):
        """The number (n,) of the part on which each point lies, or past whose edge."""
        off = [np.abs(np.linalg.norm(x - one.center, axis=1) - one.radius) for one in self.parts]
        if self.solid:
            off = [np.linalg.norm(x - one.center, axis=1) for one in self.parts]
        return np.argmin(off, axis=0)

    def relative(self, x):
        """The points relative to the centres of their parts, and those parts' radii and constants."""
        number = self.part_of(x)
        center, radius, more = (np.array([getattr(one, name) for one in self.parts]) for name in KEYS)
        return x - center[number], radius[number], more[number]

    def raised(self, x):
        """Tell where u is higher by the jump."""
        if self.inside == "nothing":
            return np.zeros(len(x), dtype=bool)
        cut = np.array([one.cut for one in self.parts])[self.part_of(x)]
        if self.solid:
            return cut & (np.linalg.norm(x - RING_CENTER, axis=1) < RING_RADIUS)
        return cut & (self.relative(x)[0][:, 0] > CUT)

    def lifted(self, x):
        """Tell which points lie within the further boundaries."""
        if not self.crowded or self.inside == "nothing":
            return np.zeros(len(x), dtype=bool)
        cut = np.array([one.cut for one in self.parts])[self.part_of(x)]
        if self.solid:
            return cut & (np.linalg.norm(x - RING_CENTER, axis=1) < RING_RADIUS + BESIDE * self.spacing)
        p, radius, _ = self.relative(x)
        turned = np.arctan2(p[:, 1], p[:, 0]) - BESIDE * self.spacing / radius
        return cut & (radius * np.cos(turned) > CUT)

    def constants(self, x):
        """What u has in addition to what is smooth."""
        return self.relative(x)[2] + JUMP * self.raised(x) + LIFT * self.lifted(x)

    def u(self, x):
        """The exact solution at time 0."""
        p = self.relative(x)[0]
        return p[:, 0] + p[:, 1] / 2 + 0.3 * p[:, 0] * p[:, 1] + self.constants(x)

    def slope(self, x, direction):
        """The derivative of u along unit vectors (n, 2) tangential to the manifold."""
        p = self.relative(x)[0]
        return (1 + 0.3 * p[:, 1]) * direction[:, 0] + (0.5 + 0.3 * p[:, 0]) * direction[:, 1]

    def minus_laplacian(self, x):
        p, radius, _ = self.relative(x)
        return 0 * radius if self.solid else (p[:, 0] + p[:, 1] / 2 + 1.2 * p[:, 0] * p[:, 1]) / radius**2

    def keeps(self, x):
        """Tell which points of the whole parts are left."""
        p = self.relative(x)[0]
        kept = (p[:, 0] >= TRIM) if self.trimmed else np.ones(len(x), dtype=bool)
        for number, one in enumerate(self.parts):
            if one.arc:
                angle = np.arctan2(p[:, 1], p[:, 0])
                kept &= (self.part_of(x) != number) | ((angle >= one.arc[0]) & (angle <= one.arc[1]))
        return kept

    def tangent(self, x):
        """Counter-clockwise, of circles."""
        p = self.relative(x)[0]
        return np.stack([-p[:, 1], p[:, 0]], axis=1) / np.maximum(np.linalg.norm(p, axis=1, keepdims=True), 1e-9)

    def outward(self, x):
        """The conormal at points of the edge."""
        p, radius, _ = self.relative(x)
        if not self.solid:
            t = self.tangent(x)
            return np.where(self.keeps(x + 1e-3 * t)[:, None], -t, t)
        size = np.maximum(np.linalg.norm(p, axis=1), 1e-9)
        on_rim = np.abs(size - radius) < 1e-6
        return np.where(on_rim[:, None], p / size[:, None], [[-1.0, 0.0]])


KEYS = ("center", "radius", "more")


def with_part(case, part):
    return replace(case, parts=(*case.parts, part))
