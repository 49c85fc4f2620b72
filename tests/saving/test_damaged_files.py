"""Checkpoints and saved solutions that are damaged, altered or made up are refused in a sentence."""

import json
import zipfile

import numpy as np
import pytest

import cpmkit as ck

CUT = ck.Boundary("cut", ck.source("analytic.point", at=[0.6, 0.8]), both=ck.Dirichlet(0.5))
HEAT = ck.Heat(lambda x: x[:, 0], until=0.5, step=0.05, frames=5)
SCENE = ck.Scene(ck.source("analytic.circle"), HEAT, [CUT])
WAVE = ck.Scene(ck.source("analytic.circle"), ck.Wave(lambda x: x[:, 0], until=0.3, step=0.05), [CUT])


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Return the arrays of a checkpoint of a heat run, of one of a wave, and of a saved solution."""
    folder = tmp_path_factory.mktemp("files")
    ck.solve(SCENE, 0.2, checkpoint=folder / "heat.npz")
    ck.solve(SCENE, 0.2, form="collocation").save(folder / "solution.npz")
    ck.solve(WAVE, 0.2, checkpoint=folder / "wave.npz")
    read = {}
    for name in ("heat", "wave", "solution"):
        with np.load(folder / f"{name}.npz") as opened:
            read[name] = {key: opened[key] for key in opened.files}
    return read


def resumed(arrays, folder, scene=SCENE):
    np.savez(folder / "run.npz", **arrays)
    return ck.solve(scene, 0.2, resume=folder / "run.npz")


def loaded(arrays, folder, scene=SCENE):
    np.savez(folder / "saved.npz", **{name: array for name, array in arrays.items() if array is not None})
    return ck.load(folder / "saved.npz", scene)


def test_a_checkpoint_as_it_was_written_is_resumed(files, tmp_path):
    assert resumed(files["heat"], tmp_path).steps == 10
    assert resumed(files["wave"], tmp_path, WAVE).steps == 6


@pytest.mark.parametrize("name", ["u_0", "u_1", "u_2", "frames"])
def test_a_state_that_was_altered_is_refused(name, files, tmp_path):
    with pytest.raises(ck.InputError, match=r"'run\.npz' is not as it was written: its arrays do not match"):
        resumed(files["heat"] | {name: files["heat"][name] + 5}, tmp_path)


def test_what_was_counted_so_far_is_part_of_the_state(files, tmp_path):
    tally = json.loads(str(files["heat"]["tally"])) | {"iterations": 7}
    with pytest.raises(ck.InputError, match="is not as it was written"):
        resumed(files["heat"] | {"tally": np.array(json.dumps(tally))}, tmp_path)


def shapes(heat):
    """Arrays in place of those of a checkpoint, and what is said of them."""
    yield {"u_2": heat["u_2"][:1]}, r"holds u_2 as float64 of shape \(1, 1\), where numbers of shape \(\d+, 1\) belong"
    yield {"u_2": heat["u_2"].ravel()}, "holds u_2 as float64 of shape"
    yield {"u_2": heat["u_2"].astype(str)}, "holds u_2 as str"
    yield {"u_2": heat["u_2"] * np.nan}, "u_2 holds NaN or infinity"
    yield {"u_2": None}, "without u_2"
    yield {"frames": heat["frames"][:2]}, "should hold 3 moments with their lengths and 6 frames, and it holds 3 and 2"
    yield {"frames": heat["frames"][0]}, "holds frames as"
    yield {"lengths": None}, "lacks the array 'lengths'"
    yield {"lengths": heat["lengths"][:2]}, "holds 2 and 6"
    yield {"lengths": heat["lengths"] * 2}, "is damaged"
    yield {"ends": heat["ends"][:0], "kept": heat["kept"][:0]}, "its 0 steps and their frames are not those"
    yield {"ends": heat["ends"][:4]}, "holds kept as"
    yield {"run": np.array("[1, 2]")}, r"a run that is not a JSON object but \[1, 2\]"
    yield {"run": np.array("null")}, "a run that is not a JSON object but None"
    yield {"run": np.array("{" * 100_000)}, "a run that is not JSON"
    yield {"run": np.array(3.0)}, "holds run as float64"
    yield {"run": np.array("{}")}, "its kind is None, and here it is 'heat'"
    yield {"tally": np.array("null")}, "is not as it was written"
    yield {"contents": None}, "lacks the array 'contents'"


def test_arrays_of_another_shape_or_type_are_refused(files, tmp_path):
    for changes, message in shapes(files["heat"]):
        arrays = {name: array for name, array in (files["heat"] | changes).items() if array is not None}
        with pytest.raises(ck.InputError, match=message):
            resumed(arrays, tmp_path)


def test_a_wave_without_its_rates_is_refused(files, tmp_path):
    arrays = {name: array for name, array in files["wave"].items() if name != "rate_1"}
    with pytest.raises(ck.InputError, match="without rate_1"):
        resumed(arrays, tmp_path, WAVE)


@pytest.mark.parametrize("content", [b"", b"PK", b"PK\x05\x06" + bytes(18), b"\x93NUMPY"])
def test_what_a_crash_of_the_machine_leaves_is_refused(content, tmp_path):
    (tmp_path / "run.npz").write_bytes(content)
    with pytest.raises(ck.InputError, match=r"'run\.npz' (is damaged or not|is not) a checkpoint of a run in time"):
        ck.solve(SCENE, 0.2, resume=tmp_path / "run.npz")
    with pytest.raises(ck.InputError, match=r"'run\.npz' (is damaged or not|is not) a solution that was saved"):
        ck.load(tmp_path / "run.npz")


@pytest.mark.parametrize("name", ["heat", "solution"])
def test_arrays_that_nothing_needs_are_not_read(name, files, tmp_path, monkeypatch):
    """Their headers promise more than any machine has: to read one would be an error of its own."""
    path = tmp_path / "large.npz"
    np.savez_compressed(path, **files[name])
    with zipfile.ZipFile(path, "a") as archive, archive.open("lattice_junk.npy", "w") as member:
        header = {"descr": "<f8", "fortran_order": False, "shape": (10**12, 3)}
        np.lib.format.write_array_header_1_0(member, header)
    if name == "heat":
        assert ck.solve(SCENE, 0.2, resume=path).steps == 10
    else:
        assert "lattice_junk" not in ck.load(path).arrays


def test_a_known_array_of_another_size_is_refused_before_it_is_read(files, tmp_path, monkeypatch):
    path = tmp_path / "large.npz"
    large = np.zeros((2_000_000, 1))
    np.savez_compressed(path, u_2=large, **{name: array for name, array in files["heat"].items() if name != "u_2"})
    read, frombuffer = [], np.frombuffer
    monkeypatch.setattr(np, "frombuffer", lambda buffer, **keys: read.append(len(buffer)) or frombuffer(buffer, **keys))
    with pytest.raises(ck.InputError, match=r"holds u_2 as float64 of shape \(2000000, 1\)"):
        ck.solve(SCENE, 0.2, resume=path)
    np.savez_compressed(path, values=large, **{k: one for k, one in files["solution"].items() if k != "values"})
    with pytest.raises(ck.InputError, match=r"of shape \(\d+, 2\), where numbers of shape \(2000000, 2\) belong"):
        ck.load(path)
    np.savez_compressed(path, summary=np.zeros((), dtype="U20000000"), format=np.array(1))
    with pytest.raises(ck.InputError, match="holds 80000000 bytes of text as summary"):
        ck.load(path)
    assert 0 < max(read) < 100_000


def summaries(solution):
    """Summaries in place of that of a solution, and what is said of them without and with its scene."""
    summary = json.loads(str(solution["summary"]))
    for text in ("", "[]", "3", "null", "nonsense", "[" * 100_000):
        yield text, "a summary that is not", "a summary that is not"
    yield "{}", "lacks 'discretization'", "lacks 'discretization'"
    for key in ("report", "work", "seconds", "warnings", "scene"):
        yield (
            json.dumps({one: value for one, value in summary.items() if one != key}),
            f"lacks {key!r}",
            f"lacks {key!r}",
        )
        told = f"{key} of the summary of 'saved.npz' must be"
        yield json.dumps(summary | {key: 3}), told, told
    yield json.dumps(summary | {"discretization": {"channels": "a"}}), "channels of", "channels of"
    yield (
        json.dumps(summary | {"report": {}}),
        None,
        "report in the summary of 'saved.npz' lacks 'solver', which must be text",
    )
    yield (
        json.dumps(summary | {"work": summary["work"] | {"nodes": -1}}),
        None,
        "nodes of work in .* at least 0, got -1",
    )
    yield json.dumps(summary | {"imbalances": [{"share": 1.0}]}), None, "an imbalance in .* lacks 'of'"
    other = {"of": "heat", "value": [1.0], "size": [1.0], "explained": 0.1}
    yield json.dumps(summary | {"imbalances": [other]}), None, "of of an imbalance in .* one of data, mean, fluxes"
    yield json.dumps(summary | {"scene": {"problem": 3, "boundaries": []}}), "problem of scene", "problem of scene"


def test_summaries_that_are_none_are_refused(files, tmp_path):
    for text, without, with_scene in summaries(files["solution"]):
        arrays = files["solution"] | {"summary": np.array(text)}
        for scene, message in ((None, without), (SCENE, with_scene)):
            if message is not None:
                with pytest.raises(ck.InputError, match=message):
                    loaded(arrays, tmp_path, scene)


def test_arrays_of_a_solution_that_do_not_fit_are_refused(files, tmp_path):
    solution = files["solution"]
    wrong = [
        ({"format": np.array([1, 1])}, "holds format as"),
        ({"points": None}, "half a mesh"),
        ({"values": solution["values"][:3]}, "holds values as"),
        ({"values": solution["values"] * np.nan}, "values holds NaN"),
        ({"cells": solution["cells"] + 10**6}, "half a mesh"),
        ({"cells": solution["cells"].astype(float)}, "holds cells as float64"),
        ({"lattice_spacing": None}, "lacks the array 'lattice_spacing'"),
        ({"lattice_spacing": np.array(np.inf)}, "lattice_spacing holds NaN or infinity"),
        ({"lattice_degree": np.array("a")}, r"'saved\.npz' is damaged: degree must be one of 2, 3, 4, 5, got 'a'"),
        ({"lattice_nodes": solution["lattice_nodes"].astype(float)}, "holds lattice_nodes as float64"),
        ({"lattice_unknowns": None}, "lacks the array 'lattice_unknowns'"),
        ({"lattice_origin": np.zeros(3)}, "where .* belong"),
        ({"lattice_origin": np.array([1e300, 0])}, "another scene than the one given: its nodes are elsewhere"),
        ({"lattice_spacing": np.array(-0.2)}, "another scene than the one given: its nodes are elsewhere"),
        ({"lattice_frames": np.zeros((2, 3, 1))}, "holds lattice_"),
    ]
    for changes, message in wrong:
        with pytest.raises(ck.InputError, match=message):
            loaded(solution | changes, tmp_path)


def test_paths_that_name_no_file_are_refused(tmp_path):
    for given in (3, True, "\0", "a" * 300 + ".npz", tmp_path):
        with pytest.raises(ck.InputError):
            ck.solve(SCENE, 0.2, resume=given)
        with pytest.raises(ck.InputError):
            ck.solve(SCENE, 0.2, checkpoint=given)
    for given in ("\0", "a" * 300 + ".npz", tmp_path):
        with pytest.raises(ck.InputError, match="There is no file"):
            ck.load(given)
    with pytest.raises(ck.InputError, match="needs its path, got 3"):
        ck.load(3)
