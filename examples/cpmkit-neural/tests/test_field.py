"""A network's derivatives are those of its function, and only files with a whole network are read."""

import numpy as np
import pytest
from cpmkit_neural.cases import SPOT_FILE, rounded_cube
from cpmkit_neural.field import read_network
from cpmkit_neural.plugin import neural_field

from cpmkit.plugin import InputError


def test_derivatives_of_one_layer_are_those_of_its_closed_form():
    x = np.random.default_rng(0).uniform(-4, 4, (200, 3))
    value, gradient, hessian = rounded_cube().field.hessian(x)
    np.testing.assert_allclose(value, 2 - np.cos(x).sum(axis=1), atol=1e-14)
    np.testing.assert_allclose(gradient, np.sin(x), atol=1e-14)
    np.testing.assert_allclose(hessian, np.cos(x)[:, :, None] * np.eye(3), atol=1e-14)


def test_derivatives_of_many_layers_are_the_limits_of_differences():
    network, bounds = read_network(SPOT_FILE)
    x = np.random.default_rng(1).uniform(*bounds, (50, 3))
    _, gradient, hessian = network.hessian(x)
    errors = []
    for h in (4e-3, 2e-3, 1e-3):
        ahead, behind = (np.stack([network.value(x + s * h * e) for e in np.eye(3)], axis=1) for s in (1, -1))
        slopes = [network.gradient(x + h * e)[1] - network.gradient(x - h * e)[1] for e in np.eye(3)]
        off = [(ahead - behind) / (2 * h) - gradient, np.stack(slopes, axis=1) / (2 * h) - hessian]
        errors.append([np.abs(part).max() for part in off])
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert (orders > 1.9).all()
    np.testing.assert_array_equal(network.gradient(x)[1], gradient)


@pytest.mark.parametrize("change", ["lacks a bias", "two values", "no network", "text", "objects"])
def test_other_files_are_refused(change, tmp_path):
    arrays = dict(np.load(SPOT_FILE))
    if change == "lacks a bias":
        del arrays["bias1"]
    if change == "two values":
        arrays["weight3"], arrays["bias3"] = np.ones((48, 2)), np.ones(2)
    if change == "no network":
        arrays = {"bounds": arrays["bounds"]}
    if change == "objects":
        arrays["weight0"] = np.array([None])
    np.savez(tmp_path / "network.npz", **arrays)
    if change == "text":
        (tmp_path / "network.npz").write_text("weights")
    with pytest.raises(InputError, match=r"network\.npz must (be|hold)"):
        neural_field(file=tmp_path / "network.npz")
