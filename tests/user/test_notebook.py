"""What an executed notebook holds: tables with pictures, pages to turn, plots, and no noise."""

import base64
import io

import pytest
from PIL import Image

CELLS = (
    """import cpmkit as ck
equator = ck.source("analytic.circle", normal=[0, 0, 1])
cut = ck.Boundary("equator", equator, left=1.0, right=0.0)
scene = ck.Scene(ck.source("analytic.sphere"), ck.Laplace(), [cut])
scene""",
    "ck.explain(scene, spacing=0.3)",
    "solution = ck.solve(scene, spacing=0.3)\nsolution",
    "solution.show(cmap='magma')",
    "solution.plot(width=200);",
    "ck.source('analytic.sphere')",
)


@pytest.fixture(scope="module")
def executed(tmp_path_factory):
    nbformat, nbclient = pytest.importorskip("nbformat"), pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(cell) for cell in CELLS])
    folder = tmp_path_factory.mktemp("notebook")
    nbclient.NotebookClient(
        notebook, timeout=120, kernel_name="python3", resources={"metadata": {"path": folder}}
    ).execute()
    nbformat.validate(notebook)
    return [cell.outputs for cell in notebook.cells]


def html(outputs):
    (shown,) = [one for one in outputs if one.output_type == "execute_result"]
    return shown.data["text/html"]


@pytest.mark.slow
def test_an_executed_notebook_shows_tables_pictures_and_pages(executed):
    scene, explained, solution, page, plot, source = executed
    assert "dirichlet on the left" in html(scene)
    assert "unknowns" in html(explained)
    shown = html(solution)
    picture = base64.b64decode(shown.partition("data:image/png;base64,")[2].partition('"')[0])
    with Image.open(io.BytesIO(picture)) as image:
        assert image.width == 400
    assert "Solution of laplace" in shown
    assert html(page).startswith("<iframe srcdoc=")
    assert [one for one in plot if "image/png" in one.get("data", {})]
    assert "a surface in 3D" in source[0].data["text/plain"]


@pytest.mark.slow
def test_an_executed_notebook_has_no_noise(executed):
    noise = [one for outputs in executed for one in outputs if one.output_type in ("stream", "error")]
    assert [one.get("text", one.get("evalue")) for one in noise] == []
