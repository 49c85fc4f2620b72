"""Constants survive: E 1 = 1, and u = constant solves every zero-Neumann problem, to 1e-12 (row 26)."""

import numpy as np
import pytest

import cpmkit as ck

SCENES = {
    "circle cut by a wall": ("analytic.circle", {"center": (0, 0)}, [("analytic.point", {"at": (0.6, 0.8)})]),
    "open arc": ("analytic.arc", {"center": (0, 0), "radius": 1.0, "start": 0.3, "end": 2.7}, []),
    "sphere with a wall": (
        "analytic.sphere",
        {},
        [("analytic.circle", {"center": (0, 0, 0.2), "radius": np.sqrt(0.96), "normal": (0, 0, 1)})],
    ),
    "cap with an open wall": (
        "analytic.cap",
        {"height": 0.2},
        [
            (
                "analytic.arc",
                {
                    "center": (0, 0, 0),
                    "radius": 1.0,
                    "start": 0.9,
                    "end": 2.0,
                    "normal": (1, 0, 0),
                    "x_axis": (0, 1, 0),
                },
            )
        ],
    ),
    "cylinder": ("analytic.cylinder", {"radius": 0.7, "length": 2.0}, []),
    "torus": ("analytic.torus", {"major": 1.0, "minor": 0.5}, []),
}


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("name", SCENES)
def test_constants_are_reproduced(name, order):
    kind, keys, walls = SCENES[name]
    boundaries = [
        ck.Boundary(f"wall {k}", ck.source(*[one], **two), both=ck.Neumann(0.0)) for k, (one, two) in enumerate(walls)
    ]
    scene = ck.Scene(ck.source(kind, **keys), ck.ScreenedPoisson(3.0, c=1.5), boundaries)
    form = ck.discretize(scene, 0.2, order=order)
    tables = form.tables
    ones = np.ones(tables.unknowns.count)
    np.testing.assert_allclose(tables.extension @ ones, 1.0, atol=1e-12)
    assert not tables.datum().any()
    operator = ck.assemble(form).operator
    np.testing.assert_allclose(operator.apply(ones), 1.5, atol=1e-12 * operator.diagonal)
    solution = ck.solve(scene, 0.2, order=order, solver_tolerance=1e-12, solver="direct")
    np.testing.assert_allclose(solution.values, 2.0, rtol=1e-10)
