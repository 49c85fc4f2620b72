"""Memory is what this process may have; where it runs out, one sentence says what was needed and what would fit."""

import os
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest

import cpmkit as ck
from cpmkit.grid.lattice import fitting_spacing
from cpmkit.plugin import as_vector, localize
from cpmkit.runtime import memory

GIB = 2**30


def scene(kind="analytic.sphere", **keys):
    return ck.Scene(ck.source(kind, **keys), ck.ScreenedPoisson(1.0))


def one_sentence(error, *parts):
    text = str(error.value)
    assert text.endswith(".")
    assert "\n" not in text
    for part in parts:
        assert part in text, text
    return text


@pytest.fixture
def unlimited(tmp_path, monkeypatch):
    """Let there be a machine of 64 GiB without any other limit, and control groups in ``tmp_path``."""
    monkeypatch.setattr(memory, "machine_bytes", lambda: 64 * GIB)
    limits = memory._group_limits.__wrapped__
    monkeypatch.setattr(memory, "_group_limits", lambda *_: limits(tmp_path / "own", tmp_path, 0))
    monkeypatch.setattr(memory, "_process_limits", lambda: ())
    return tmp_path


def test_without_limits_it_is_the_machine_s(unlimited):
    assert memory.available_bytes() == 64 * GIB
    assert str(memory.memory_limit()) == "this machine has 64 GiB"


@pytest.mark.parametrize("root", ["", "unified"])
def test_control_groups_of_version_2_limit_those_within_them(unlimited, root):
    (unlimited / "own").write_text("0::/slice/job\n")
    job = unlimited / root / "slice" / "job"
    job.mkdir(parents=True)
    (job / "memory.max").write_text("max\n")
    assert memory.available_bytes() == 64 * GIB
    (job.parent / "memory.max").write_text(f"{3 * GIB}\n")
    assert str(memory.memory_limit()) == "the control group of this process (its container) has 3 GiB"


def test_control_groups_of_version_1_and_of_a_container_that_does_not_see_its_path(unlimited):
    (unlimited / "own").write_text("5:cpu:/x\n4:memory,hugetlb:/docker/abc\n")
    (unlimited / "memory").mkdir()
    (unlimited / "memory" / "memory.limit_in_bytes").write_text("9223372036854771712\n")
    assert memory.available_bytes() == 64 * GIB
    (unlimited / "memory" / "memory.limit_in_bytes").write_text(f"{2 * GIB}\n")
    assert memory.available_bytes() == 2 * GIB


@pytest.mark.parametrize(("name", "option"), [("RLIMIT_AS", "-v"), ("RLIMIT_DATA", "-d")])
def test_ulimit_counts_with_what_is_in_use(monkeypatch, name, option):
    import resource

    target = getattr(resource, name)
    endless = resource.RLIM_INFINITY
    monkeypatch.setattr(resource, "getrlimit", lambda which: (10 * GIB if which == target else endless, endless))
    monkeypatch.setattr(memory, "machine_bytes", lambda: 64 * GIB)
    text_of = memory._read_text
    status = "VmSize:\t 2097152 kB\nVmData:\t 2097152 kB\n"
    monkeypatch.setattr(memory, "_read_text", lambda path: status if path.name == "status" else text_of(path))
    monkeypatch.setattr(memory, "_group_limits", lambda *_: [])
    limit = memory.memory_limit()
    assert limit.bytes == 8 * GIB
    assert limit.subject == f"`ulimit {option}` leaves this process"


FORMS = pytest.mark.parametrize("form", ["collocation", "galerkin"])


@FORMS
@pytest.mark.parametrize("spacing", [1e-7, 1e-4, 0.004])
def test_solve_and_explain_name_the_same_spacing_and_it_fits(monkeypatch, spacing, form):
    monkeypatch.setattr(memory, "memory_limit", lambda: memory.MemoryLimit(64 * 2**20, "this machine has"))
    named = set()
    for call in (ck.solve, ck.explain):
        with pytest.raises(ck.ResolutionError) as error:
            call(scene(), spacing, form=form)
        text = one_sentence(error, "unknowns and", "this machine has 0.0625 GiB", "or more would fit")
        named.add(text.partition("; spacing=")[2].split()[0])
    assert len(named) == 1
    assert ck.explain(scene(), float(named.pop()), form=form, dry_run=True).bytes < 64 * 2**20


@pytest.mark.parametrize("channels", [3, 10])
def test_the_spacing_that_fits_holds_all_channels(monkeypatch, channels):
    monkeypatch.setattr(memory, "memory_limit", lambda: memory.MemoryLimit(4 * 2**20, "this machine has"))
    circle = ck.Scene(ck.source("analytic.circle"), ck.ScreenedPoisson([1.0] * channels))
    options = {"form": "collocation", "degree": 3, "solver": "reference"}
    named = set()
    for dry_run in (False, True):
        with pytest.raises(ck.ResolutionError) as error:
            ck.explain(circle, 1e-5, dry_run=dry_run, **options)
        named.add(str(error.value).partition("; spacing=")[2].split()[0])
    assert len(named) == 1
    assert ck.explain(circle, float(named.pop()), dry_run=True, **options).bytes < 4 * 2**20


def test_the_spacing_that_fits_moves_and_scales_with_the_model():
    moved = {"center": [1e6, -1e6, 0]}
    at = [localize(ck.source("analytic.sphere", **keys), as_vector([0, 0, 0], 3, "")) for keys in ({}, moved)]
    small = localize(ck.source("analytic.sphere", radius=1e-6), np.zeros(3))
    fits = [fitting_spacing(one, 3, GIB) for one in (*at, small)]
    np.testing.assert_allclose(fits, [fits[0], fits[0], 1e-6 * fits[0]], rtol=0.011)


@pytest.mark.parametrize(
    ("form", "mebibytes", "other"), [("collocation", 24, "reference"), ("galerkin", 40, "multigrid")]
)
def test_factors_that_cannot_fit_are_refused_before_the_factorisation(monkeypatch, form, mebibytes, other):
    monkeypatch.setattr(memory, "memory_limit", lambda: memory.MemoryLimit(mebibytes * 2**20, "this machine has"))
    named = set()
    for call in (ck.solve, ck.explain):
        with pytest.raises(ck.ResolutionError) as error:
            call(scene(), 0.1, form=form, solver="direct")
        text = one_sentence(error, "with the solver 'direct'", f"or more would fit, or solver={other!r}")
        named.add(text.partition("; spacing=")[2].split()[0])
    assert ck.solve(scene(), float(named.pop()), form=form, solver="direct").report.converged
    assert not named


@FORMS
@pytest.mark.parametrize(
    "raised",
    [MemoryError(), OSError(12, os.strerror(12)), ImportError("x.so: failed to map segment from shared object")],
)
def test_memory_that_runs_out_in_a_solve_is_one_sentence(monkeypatch, raised, form):
    def fail(*arguments, **options):
        raise raised

    monkeypatch.setattr("scipy.sparse.linalg.splu", fail)
    monkeypatch.setattr("cpmkit.linear.direct.dense_cholesky", fail)
    with pytest.raises(ck.ResolutionError) as error:
        ck.solve(scene(), 0.3, form=form, solver="direct")
    one_sentence(error, "Memory ran out at spacing=0.3", "unknowns need", "'direct'", "try spacing=0.45 or more")
    assert error.value.__cause__ is raised


@FORMS
def test_an_allocation_that_fails_lets_go_of_the_tables(monkeypatch, form):
    references = []

    def allocate(tables, *rest):
        import weakref

        references.append(weakref.ref(tables))
        np.empty(10**17)

    monkeypatch.setattr("cpmkit.families.steady.with_border", allocate)
    with pytest.raises(ck.ResolutionError, match="Memory ran out") as error:
        ck.solve(scene(), 0.3, form=form)
    assert error.value.__cause__ is not None
    assert references[0]() is None


@pytest.mark.parametrize(
    ("form", "step"),
    [
        ("collocation", "cpmkit.forms.collocation.collocation_cost.build_layout"),
        ("galerkin", "cpmkit.forms.galerkin.discretize_scene.discretize"),
    ],
)
def test_memory_that_runs_out_while_explaining_is_one_sentence(monkeypatch, form, step):
    def fail(*arguments, **options):
        raise MemoryError

    monkeypatch.setattr(step, fail)
    with pytest.raises(ck.ResolutionError) as error:
        ck.explain(scene(), 0.3, form=form, dry_run=True)
    one_sentence(error, "Memory ran out at spacing=0.3", "or more")


def test_other_errors_are_left_alone(monkeypatch):
    def fail(*arguments):
        raise RuntimeError("a defect")

    monkeypatch.setattr("cpmkit.families.steady.with_border", fail)
    with pytest.raises(RuntimeError, match="a defect"):
        ck.solve(scene(), 0.3)
    assert memory.is_out_of_memory(RuntimeError("can't start new thread"))
    assert not memory.is_out_of_memory(SimpleNamespace())


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere address space has no limit")
def test_ulimit_is_seen_by_the_command(tmp_path):
    (tmp_path / "sphere.toml").write_text('[surface]\nkind = "analytic.sphere"\n[problem]\nkind = "laplace"\n')
    run = "import sys; from cpmkit.cli import main; main(['solve', 'sphere.toml', '--spacing', '0.005'])"
    few = {**os.environ, "CPMKIT_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    command = ["bash", "-c", f'ulimit -v 1500000; exec "{sys.executable}" -c "{run}"']
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, env=few, check=False)
    assert done.returncode == 1
    assert "`ulimit -v` leaves this process" in done.stderr
    assert "would fit" in done.stderr
