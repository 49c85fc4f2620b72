"""The plugin is light to import, offers its kinds by name, and brings a case for each sort of shape."""

import subprocess
import sys

import numpy as np
import pytest
from cpmkit_mesh import plugin

import cpmkit.plugins


def test_importing_the_plugin_imports_nothing_heavy():
    code = "import sys, cpmkit_mesh; print(*(m for m in ('numba', 'scipy', 'trimesh') if m in sys.modules))"
    done = subprocess.run([sys.executable, "-P", "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []


def test_kinds_are_found_by_name():
    square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    mesh = cpmkit.plugins.source("mesh.triangles", vertices=square, faces=[[0, 1, 2], [0, 2, 3]])
    assert mesh.closest_point(np.array([[0.5, 0.5, 1.0]])).distance == pytest.approx(1.0)
    line = cpmkit.plugins.source("mesh.polyline", points=square, closed=True)
    assert line.closest_point(np.array([[0.5, 0.5, 0.0]])).distance == pytest.approx(0.5)


def test_every_kind_has_cases_whose_samples_lie_on_it():
    pytest.importorskip("cpmkit.testing")
    cases = plugin.cpmkit_conformance_cases()
    assert {case.kind for case in cases} == set(plugin.cpmkit_sources())
    for case in cases:
        source = case.make()
        assert source.closest_point(case.samples(np.random.default_rng(1), 200)).distance.max() < 1e-14


def test_kernels_run_without_a_folder_to_keep_them_in_and_say_so_once(tmp_path):
    """Where numba may write nowhere, kernels are compiled once a process."""
    code = """
import numba.core.caching
numba.core.caching.CacheImpl._locator_classes = []
from cpmkit.runtime.compilation import compiled
def double(x):
    return 2 * x
def treble(x):
    return 3 * x
assert compiled(double)(3) == 6
assert compiled(treble)(3) == 9
"""
    run = subprocess.run([sys.executable, "-P", "-c", code], check=True, cwd=tmp_path, capture_output=True, text=True)
    assert run.stderr.count("CpmkitWarning: There is no folder in which compiled kernels can be kept") == 1
    assert "NUMBA_CACHE_DIR" in run.stderr
