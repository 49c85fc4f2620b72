"""The cheap variant of the benchmark of junctions: orders in the plane, estimates, and the total of heat."""

from model_problems import order_of


def test_junctions_in_the_plane(quick_rows):
    rows = quick_rows("junctions")
    *steady, heat = rows
    for case in {(row["members"], row["data"]) for row in steady}:
        found = [row for row in steady if (row["members"], row["data"]) == case]
        spacings = [float(row["h"]) for row in found]
        assert spacings == [0.2, 0.1, 0.05]
        assert order_of(spacings, [float(row["Galerkin"]) for row in found]) > 2.5
        assert all(float(row["Galerkin"]) < 0.01 * float(row["collocation"]) for row in found)
    ratios = [row["estimate over error, Galerkin"] for row in steady if row["members"] == "disk and boundary"]
    assert all(0.5 < float(text.split()[0]) < 2 for text in ratios)
    assert heat["data"].startswith("total")
    assert float(heat["Galerkin"]) < 1e-11
