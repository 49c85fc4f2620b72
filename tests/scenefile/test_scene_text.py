"""What a scene file may not hold is refused by its key, in one sentence that names what may be meant."""

import os
import subprocess
import sys

import pytest
from click.testing import CliRunner
from fuzzing import answered

import cpmkit as ck
from cpmkit.cli import main

SCENE = """
{top}
[surface]
{surface}
[[boundary]]
{boundary}
kind = "analytic.point"
at = [1, 0]
[problem]
{problem}
[discretization]
{grid}
[solver]
{solver}
[output]
{output}
"""
USUAL = {
    "top": "",
    "surface": 'kind = "analytic.circle"',
    "boundary": 'name = "pin"\nboth = { dirichlet = 1 }',
    "problem": 'kind = "laplace"',
    "grid": "spacing = 0.2",
    "solver": "",
    "output": "",
}
DIGITS = "1" * 400
NAME = "a" * 300

REFUSED = [
    ("top", "a = " + "[" * 5000, "nests more than 40 tables or lists"),
    ("top", "a = " + "[" * 300 + "]" * 300, "nests more than 40 tables or lists"),
    ("top", "a" + ".a" * 500 + " = 1", "nests more than 40 tables or lists"),
    ("surface", 'kind = "analytic.circle"\nradius = ' + "1" * 5000, "not TOML: a number has too many digits"),
    ("surface", f'kind = "analytic.circle"\nradius = {DIGITS}', "the key 'radius' is a whole number beyond 9.2e18"),
    ("grid", f"spacing = {DIGITS}", "the key 'spacing' is a whole number beyond"),
    ("boundary", f"both = {{ dirichlet = {DIGITS} }}", "the key 'dirichlet' is a whole number beyond"),
    ("boundary", r'name = "a\u001b[31m"' + "\nboth = { dirichlet = 1 }", "the key 'name' holds the control character"),
    ("boundary", r'"a\u0007" = 1', "a key of an entry of the key 'boundary' holds the control character"),
    ("boundary", 'name = ["a"]\nboth = { dirichlet = 1 }', "name of .* must be one line of at most 100 characters"),
    ("boundary", 'name = "a\\nb"\nboth = { dirichlet = 1 }', "name of .* must be one line"),
    ("boundary", 'name = "a"\nlefft = { dirichlet = 1 }', r"unknown key 'lefft' \(did you mean 'left'\?\)"),
    ("boundary", 'name = "a"\nboth = { dirichelt = 1 }', r"did you mean 'dirichlet'\?"),
    ("boundary", 'both = { robin = ["1", 2, 3] }', "alpha of both of .* must be a finite number, got '1'"),
    (
        "boundary",
        'both = { dirichlet = "sin(x, y)" }',
        "both of .*'boundary 1': the formula .* calls sin with 2",
    ),
    ("boundary", "both = { dirichlet = 1, order = true }", "order of both of .* whole number from 1 to 4, got True"),
    ("boundary", 'across = { left = "a" }', "left"),
    ("surface", 'kind = "analytic.circle"\nedge = { "²" = { dirichlet = 1 } }', "edge must be one of"),
    ("surface", 'kind = "analytic.circle"\nradius = "1.0"', "radius must be a finite number above zero, got '1.0'"),
    ("surface", 'kind = "analytic.circle"\nradius = true', "radius must be a finite number above zero, got True"),
    ("surface", 'kind = "analytic.circle"\ncenter = ["0", "0"]', "center must be 2 numbers"),
    ("surface", 'kind = "analytic.circle"\ncenter = [true, 0]', "center must be 2 numbers"),
    ("surface", 'kind = "mesh.triangles"\nfile = 3', "file of .*surface.* must be the name of a file, got 3"),
    ("surface", 'kind = "shpere"', "did you mean 'analytic.sphere'?"),
    ("surface", 'kind = "analytic.shpere"', "did you mean 'analytic.sphere'?"),
    ("surface", f'kind = "{NAME * 30}"', "No plugin provides the kind"),
    ("problem", 'kind = ["laplace"]', "the kind of .problem. must be one of"),
    ("problem", 'kind = { a = "laplace" }', "the kind of .problem. must be one of"),
    ("problem", 'kind = "laplase"', r"did you mean 'laplace'\?"),
    ("problem", 'kind = "laplace"\nf = 1', "unknown key 'f'; it takes no further keys"),
    ("problem", 'kind = "screened"\nf = 1\nc = "1"', "c of .* must be a number, got '1'"),
    ("problem", 'kind = "elliptic"\nc = [1, 2]', "c of .problem. must be one number or formula"),
    ("problem", 'kind = "eigen"\ncount = 3.0', "count of .* must be a whole number, got 3.0"),
    ("problem", 'kind = "screened"\nf = 2020-01-01', "f of .problem. must be a number, a formula"),
    ("solver", 'kind = ["direct"]', "kind of .solver. must be a name"),
    (
        "solver",
        'max_iterations = "a"',
        r"\[solver\]: max_iterations of .* whole number of at least 1, got 'a'",
    ),
    ("solver", "tolerence = 1e-8", r"did you mean 'tolerance'\?"),
    ("grid", "spacing = true", r"\[discretization\]: spacing must be a finite number above zero, got True"),
    ("grid", 'spacing = "0.1"', r"\[discretization\]: spacing must be a finite number above zero, got '0.1'"),
    ("grid", "spacing = 0.2\ndegree = 3.0", r"\[discretization\]: degree must be one of 2, 3, 4, 5, got 3.0"),
    ("output", "folder = 3", "folder of .output. must be a name, got 3"),
    ("output", 'folder = ["a"]', "folder of .output. must be a name"),
    ("output", 'folder = "../x"', "must be a relative path inside the working directory, .* --output"),
    ("output", 'folder = "/abs"', "must be a relative path inside the working directory"),
    ("output", r'folder = "a\u0000b"', "holds the control character"),
    ("output", f'folder = "{NAME}"', "a name of at most 200 bytes"),
    ("output", 'files = "summary.json"', r"must be a list of names, such as \['summary.json'\], got 'summary.json'"),
    ("output", "files = 3", "must be a list of names"),
    ("output", 'files = ["../../x.json"]', "must be a relative path inside the output folder"),
    ("output", 'files = ["/abs/x.json"]', "must be a relative path inside the output folder"),
    ("output", r'files = ["..\\x.json"]', "must be a relative path inside the output folder"),
    ("output", 'files = ["C:x.json"]', "must be a relative path inside the output folder"),
    ("output", f'files = ["{NAME}.json"]', "a name of at most 200 bytes"),
    ("output", 'picture = { file = "../../x.png" }', "must be a relative path inside the output folder"),
    ("output", 'picture = { width = "a" }', "width of picture of .output. must be a whole number"),
    ("output", 'picture = { curves = "a" }', "curves of picture of .output. must be true or false"),
]


def written(folder, **parts):
    file = folder / "scene.toml"
    file.write_text(SCENE.format(**{**USUAL, **parts}), encoding="utf-8")
    return file


@pytest.mark.parametrize(("part", "text", "message"), REFUSED, ids=[text[:40] for _, text, _ in REFUSED])
def test_characters_that_are_not_accepted_are_reported(tmp_path, part, text, message):
    file = written(tmp_path, **{part: text})
    with pytest.raises((ck.InputError, ck.PluginError), match=message):
        ck.load_scene(file)
    assert "\n" not in str(answered(lambda: ck.load_scene(file)))


@pytest.mark.parametrize("data", ["1/0", "1 % 0", "0**-1", "9**9**9", "(-1)**0.5", "(-8)**(1/3)", "log(x - 5)"])
def test_data_without_a_value_are_not_finite(tmp_path, data):
    for part, text in (
        ("boundary", f'both = {{ dirichlet = "{data}" }}'),
        ("problem", f'kind = "screened"\nf = "{data}"'),
        ("problem", f'kind = "elliptic"\nf = 1\nc = "{data}"'),
        ("problem", f'kind = "elliptic"\nf = 1\nvelocity = ["{data}", 0]'),
    ):
        file = written(tmp_path, **{part: text})
        with pytest.raises(ck.InputError, match="must be finite"):
            ck.solve(ck.load_scene(file).scene, 0.25)


def test_a_byte_order_mark_is_no_matter(tmp_path):
    file = written(tmp_path)
    file.write_bytes(b"\xef\xbb\xbf" + file.read_bytes())
    assert ck.load_scene(file).spacing == 0.2


def test_a_file_beyond_all_measure_is_not_parsed(tmp_path):
    file = tmp_path / "scene.toml"
    file.write_bytes(b"# " + b"x" * 2**24)
    with pytest.raises(ck.SceneError, match=r"more than 16 MiB; write long lists into \.npy files"):
        ck.load_scene(file)


def test_links_lead_no_results_out(tmp_path, monkeypatch):
    inside, outside = tmp_path / "inside", tmp_path / "outside"
    inside.mkdir(), outside.mkdir()
    (inside / "away").symlink_to(outside, target_is_directory=True)
    monkeypatch.chdir(inside)
    for output in ('folder = "away"', 'folder = "away/more"', 'folder = "."\nfiles = ["away/summary.json"]'):
        written(inside, output=output)
        result = CliRunner().invoke(main, ["solve", "--quiet", "scene.toml"])
        assert result.exit_code == 1
        assert "a link leads" in result.output
    assert not list(outside.iterdir())
    written(inside)
    result = CliRunner().invoke(main, ["solve", "--quiet", "scene.toml", "--output", str(outside / "given")])
    assert result.exit_code == 0, result.output
    assert [file.name for file in (outside / "given").iterdir()] == ["summary.json"]


def test_in_ascii_other_names_are_escaped_or_refused(tmp_path):
    environment = {**os.environ, "LC_ALL": "C", "PYTHONUTF8": "0"}

    def called(command):
        code = [sys.executable, "-c", "from cpmkit.cli import main; main()", command, "scène.toml"]
        return subprocess.run(code, cwd=tmp_path, env=environment, capture_output=True, check=False)

    file = written(tmp_path, boundary='name = "naïve"\nboth = { dirichlet = 1 }')
    file.rename(tmp_path / "scène.toml")
    done = called("solve")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "scène" / "summary.json").is_file()
    written(tmp_path, output='folder = "é"').rename(tmp_path / "scène.toml")
    done = called("solve")
    assert done.returncode == 1, done.stderr
    assert b"in the encoding of file names here, ascii" in done.stderr
