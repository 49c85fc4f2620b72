"""What a user of pictures writes: a sheet of modes, and a page of them."""

import cpmkit as ck


def test_six_modes_as_a_sheet_and_a_page(tmp_path):
    modes = ck.solve(ck.Scene(ck.source("analytic.torus"), ck.Eigen(count=6)), spacing=0.3)
    drawn = modes.picture(tmp_path / "modes.png", title="Six modes of a torus", width=300)
    modes.save(tmp_path / "modes.html", cmap="PuOr")
    assert drawn.file.stat().st_size > 5000
    assert (tmp_path / "modes.html").read_text().count("\\u03bb = ") == 6
    assert "z up" in drawn.camera
