"""Products on all threads are those of the matrix, and do not depend on how many threads there are."""

import numpy as np
import pytest

import cpmkit as ck
from cpmkit import InputError
from cpmkit.plugin import run_parcels, thread_count


@pytest.mark.parametrize("shape", [(), (1,), (3,)])
def test_products_are_those_of_the_matrix_on_any_number_of_threads(monkeypatch, shape):
    scene = ck.Scene(ck.source("analytic.sphere"), ck.ScreenedPoisson(1.0))
    form = ck.discretize(scene, 0.2, form="collocation")
    x = np.random.default_rng(0).normal(size=(form.size, *shape))
    whole = form.stiffness(scene.problem.terms())
    wanted = whole.apply(x)
    np.testing.assert_allclose(wanted, whole.to_csr() @ x, atol=1e-11 * np.abs(wanted).max())
    monkeypatch.setattr("cpmkit.linear.csr_matrices.PARCEL_ENTRIES", 500)
    monkeypatch.setattr("cpmkit.linear.csr_matrices.MIN_SHARED_ENTRIES", 0)
    for threads in ("1", "2", "5"):
        monkeypatch.setenv("CPMKIT_THREADS", threads)
        np.testing.assert_array_equal(form.with_scene(scene).stiffness(scene.problem.terms()).apply(x), wanted)


def test_every_row_is_worked_on_once(monkeypatch):
    monkeypatch.setenv("CPMKIT_THREADS", "3")
    seen = np.zeros(1000, dtype=int)

    def mark(start, stop):
        seen[start:stop] += 1

    run_parcels(mark, 1000, 7)
    assert np.all(seen == 1)


def test_a_parcels_error_is_raised(monkeypatch):
    monkeypatch.setenv("CPMKIT_THREADS", "2")
    with pytest.raises(ZeroDivisionError):
        run_parcels(lambda start, stop: 1 // (start - 14), 100, 7)


@pytest.mark.parametrize("target", ["0", "-1", "two", "1.5"])
def test_a_number_of_threads_that_is_none(monkeypatch, target):
    monkeypatch.setenv("CPMKIT_THREADS", target)
    with pytest.raises(InputError, match="CPMKIT_THREADS must be a whole number above zero"):
        thread_count()
