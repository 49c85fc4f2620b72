"""An arc with every condition at its ends, and a circle on the sphere."""

import numpy as np
from model_problems import on_circle, rotation

import cpmkit as ck


def theta(x):
    return np.arctan2(x[:, 1], x[:, 0])


def arc_problem(edge):
    """-u'' + u = f on an arc, u = sin 2 theta + cos(theta) / 2."""
    scene = ck.Scene(
        ck.source("analytic.arc", center=(0, 0), radius=1.0, start=0.3, end=2.7),
        ck.ScreenedPoisson(lambda x: 5 * np.sin(2 * theta(x)) + np.cos(theta(x)), c=1.0),
        edge=edge,
    )
    t = np.linspace(0.3, 2.7, 2000)
    return scene, on_circle(t), np.sin(2 * t) + np.cos(t) / 2


def slope(t):
    return 2 * np.cos(2 * t) - np.sin(t) / 2


def value(x):
    return np.sin(2 * theta(x)) + np.cos(theta(x)) / 2


EDGES = {
    "Dirichlet": (ck.Dirichlet(value), 2.5e-4),
    "Neumann": ({0: ck.Neumann(-slope(0.3)), 1: ck.Neumann(slope(2.7))}, 7e-5),
    "Robin": (
        {
            0: ck.Robin(1.0, 3.0, -slope(0.3) + 3 * (np.sin(0.6) + np.cos(0.3) / 2)),
            1: ck.Robin(2.0, 6.0, 2 * slope(2.7) + 6 * (np.sin(5.4) + np.cos(2.7) / 2)),
        },
        9e-5,
    ),
    "mixed": ({0: ck.Dirichlet(float(np.sin(0.6) + np.cos(0.3) / 2)), 1: ck.Neumann(slope(2.7))}, 2.5e-4),
}


def tilted_circle(height=0.2):
    axis = rotation()[:, 2]
    return ck.source("analytic.circle", center=height * axis, radius=np.sqrt(1 - height**2), normal=axis), axis
