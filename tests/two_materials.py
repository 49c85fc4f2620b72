"""A circle of two materials, whose sides are coupled."""

import numpy as np
from model_problems import on_circle

import cpmkit as ck

CUTS = (0.4, 2.9)


def angle(x):
    return np.mod(np.arctan2(x[:, 1], x[:, 0]) - CUTS[0], 2 * np.pi)


#: Travelled from the first cut: the second lies here. Between them side A, after it side B.
SECOND = CUTS[1] - CUTS[0]


def on_a(s):
    return s < SECOND


def circle_problem(k_a=1.0, k_b=1.0, resistance=0.0):
    """-(k u')' + u = f on a circle of two materials, u = sin 2 s + 1 on A and cos(3 s) / 2 on B.

    Walking with s, A comes after the first cut and before the second: left, where the curve comes from, is B at the
    first cut and A at the second. Outward slopes are +u' on the left and -u' on the right.
    """

    def u(s):
        return np.where(on_a(s), np.sin(2 * s) + 1, 0.5 * np.cos(3 * s))

    def f(x):
        s = angle(x)
        return np.where(on_a(s), (1 + 4 * k_a) * np.sin(2 * s) + 1, (1 + 9 * k_b) * 0.5 * np.cos(3 * s))

    def cut(name, s, left_is_a):
        a, b = (np.sin(2 * s) + 1, 2 * np.cos(2 * s)), (0.5 * np.cos(3 * s), -1.5 * np.sin(3 * s))
        if not left_is_a:  # the end of B, at 2 pi
            b = (0.5 * np.cos(6 * np.pi), -1.5 * np.sin(6 * np.pi))
        (left, k_left), (right, k_right) = ((a, k_a), (b, k_b)) if left_is_a else ((b, k_b), (a, k_a))
        flux = k_left * left[1] - k_right * right[1]
        flow = 0.5 * (-k_left * left[1] - k_right * right[1])
        jump = left[0] - right[0] - resistance * flow
        point = ck.source("analytic.point", at=on_circle(np.array([CUTS[0] + s]))[0])
        across = ck.Transmission(jump=jump, flux=flux, left=k_left, right=k_right, resistance=resistance)
        return ck.Boundary(name, point, across=across)

    scene = ck.Scene(
        ck.source("analytic.circle"),
        ck.Elliptic(f, diffusivity=lambda x: np.where(on_a(angle(x)), k_a, k_b), c=1.0),
        [cut("first", 0.0, False), cut("second", SECOND, True)],
    )
    s = np.linspace(1e-6, 2 * np.pi - 1e-6, 2000)
    s = s[np.abs(s - SECOND) > 1e-5]
    return scene, on_circle(CUTS[0] + s), u(s)
