"""Curves whose sheets share a band: two circles, and a spiral."""

import numpy as np
from model_problems import on_circle

import cpmkit as ck


def circles(gap):
    """-Lap u + u = f on two concentric circles, sin 2t on the inner and 3 + cos 3t on the outer one."""
    outer = 1 + gap
    both = ck.source("union", members=[ck.source("analytic.circle"), ck.source("analytic.circle", radius=outer)])

    def inside(x):
        return np.hypot(x[:, 0], x[:, 1]) < 1 + gap / 2

    def angle(x):
        return np.arctan2(x[:, 1], x[:, 0])

    def u(x):
        return np.where(inside(x), np.sin(2 * angle(x)), 3 + np.cos(3 * angle(x)))

    def f(x):
        return np.where(inside(x), 5 * np.sin(2 * angle(x)), 3 + (1 + 9 / outer**2) * np.cos(3 * angle(x)))

    t = np.linspace(0, 2 * np.pi, 1000)
    points = np.concatenate([on_circle(t), on_circle(t, outer)])
    return ck.Scene(both, ck.ScreenedPoisson(f, c=1.0)), points, u(points)


def spiral(gap, turns=3):
    """-u'' + u = f along three turns of a spiral whose turns are ``gap`` apart; nothing flows through its ends."""
    b, end = gap / (2 * np.pi), 2 * np.pi * turns
    curve = ck.source("parametric.curve", x=[f"(1 + {b!r}*t)*cos(t)", f"(1 + {b!r}*t)*sin(t)"], range=[0, end])

    def travelled(r):
        return (r * np.sqrt(r * r + b * b) + b * b * np.arcsinh(r / b)) / (2 * b)

    k = 6 * np.pi / (travelled(1 + b * end) - travelled(1.0))

    def u(x):
        return np.cos(k * (travelled(np.hypot(x[:, 0], x[:, 1])) - travelled(1.0)))

    t = np.linspace(0, end, 3000)
    points = np.stack([(1 + b * t) * np.cos(t), (1 + b * t) * np.sin(t)], axis=1)
    return ck.Scene(curve, ck.ScreenedPoisson(lambda x: (1 + k * k) * u(x), c=1.0)), points, u(points)
