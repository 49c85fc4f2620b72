"""The cheap variant of the benchmark of solids: orders on the disk, exact linear functions, and the total of heat."""

from model_problems import order_of


def test_solids_in_the_plane(quick_rows):
    rows = quick_rows("solids")
    for condition in ("Dirichlet", "Neumann", "Robin"):
        disk = [row for row in rows if (row["solid"], row["data"]) == ("disk", condition)]
        spacings = [float(row["h"]) for row in disk]
        assert spacings == [0.2, 0.1, 0.05]
        assert order_of(spacings, [float(row["Galerkin"]) for row in disk]) > 2.8
        assert order_of(spacings, [float(row["collocation"]) for row in disk]) > 1.7
    exact = [row for row in rows if row["data"].startswith(("linear", "total"))]
    assert len(exact) == 2
    assert all(float(row["Galerkin"]) < 1e-10 for row in exact)
    assert all(float(row["Galerkin"]) < float(row["collocation"]) for row in rows if row["collocation"])
