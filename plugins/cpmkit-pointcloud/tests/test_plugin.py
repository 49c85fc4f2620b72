"""The plugin is light to import, and offers its kind by name with cases for the laws."""

import subprocess
import sys

import numpy as np
import pytest
from cpmkit_pointcloud import plugin
from cpmkit_pointcloud.conformance import sphere_samples

import cpmkit.plugins


def test_importing_the_plugin_imports_nothing_heavy():
    heavy = "('numba', 'scipy', 'trimesh', 'open3d', 'hypothesis')"
    code = f"import sys, cpmkit_pointcloud; print(*(m for m in {heavy} if m in sys.modules))"
    done = subprocess.run([sys.executable, "-P", "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []


def test_the_kind_is_found_by_name():
    cloud = cpmkit.plugins.source("pointcloud.points", points=sphere_samples(500))
    assert cloud.closest_point(np.array([[0.0, 0.0, 1.1]])).distance == pytest.approx(0.1, abs=1e-4)


def test_every_sort_of_cloud_has_a_case():
    cases = plugin.cpmkit_conformance_cases()
    assert {case.kind for case in cases} == set(plugin.cpmkit_sources())
    assert {case.make().dim for case in cases} == {2, 3}
    assert {case.make().exact for case in cases} == {True, False}
