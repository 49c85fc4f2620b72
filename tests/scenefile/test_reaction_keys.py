"""Reactions of several channels in scene files: formulas in u1, u2, position and time."""

import numpy as np
import pytest

import cpmkit as ck
from cpmkit.errors import CpmkitError

SPHERE = (
    '[surface]\nkind = "analytic.sphere"\n[discretization]\nspacing = 0.3\n[problem]\nkind = "reaction-diffusion"\n'
)
RUN = 'initial = [1, "1 + 0.5*z"]\nuntil = 0.2\nstep = 0.05\n'
AT = [[1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]


def loaded(folder, problem):
    path = folder / "scene.toml"
    path.write_text(SPHERE + problem)
    return ck.load_scene(path)


def solved(made):
    return ck.solve(made.scene, made.spacing, **made.options).evaluate(AT)


def test_formulas_are_as_a_function(tmp_path):
    made = loaded(tmp_path, RUN + 'kappa = [0.3, "0.1 + 0.05*x"]\nreaction = ["-u1*u2**2 + t", "u1*u2**2 - x*u2"]\n')

    def reaction(u, x, t):
        meeting = u[:, 0] * u[:, 1] ** 2
        return np.stack([-meeting + t, meeting - x[:, 0] * u[:, 1]], axis=1)

    by_hand = ck.ReactionDiffusion(
        [1.0, lambda x: 1 + 0.5 * x[:, 2]], reaction, [0.3, lambda x: 0.1 + 0.05 * x[:, 0]], until=0.2, step=0.05
    )
    wanted = ck.solve(ck.Scene(ck.source("analytic.sphere"), by_hand), 0.3).evaluate(AT)
    assert np.abs(solved(made) - wanted).max() < 1e-12


def test_one_channel_is_called_u_or_u1(tmp_path):
    one, other = (
        solved(
            loaded(tmp_path, f'initial = "0.5 + 0.1*x"\nuntil = 0.2\nstep = 0.05\nkappa = 0.1\nreaction = {given}\n')
        )
        for given in ('"u*(1 - u)"', '["u1*(1 - u1)"]')
    )
    assert np.array_equal(one, other)


def test_initial_data_and_kappa_of_one_number_are_for_all_channels_of_the_reaction(tmp_path):
    problem = 'initial = 0.5\nkappa = 0.1\nuntil = 0.2\nstep = 0.1\nreaction = ["u2", "u3", "-u1"]\n'
    assert loaded(tmp_path, problem).scene.channels == 3


@pytest.mark.parametrize(
    ("problem", "message"),
    [
        ('kappa = 0.1\nreaction = ["u3", "u1"]\n', "u3"),
        ("kappa = 0.1\nreaction = [1, 2]\n", "one formula a channel"),
        ("kappa = 0.1\nreaction = []\n", "got 0"),
        ("kappa = 0.1\n", "reaction"),
        ('kappa = [0.1, 0.2, 0.3]\nreaction = ["u2", "u1"]\n', "others have 3"),
        ('kappa = [[0.1], 0.2]\nreaction = ["u2", "u1"]\n', "entry 1 of kappa"),
        ('kappa = [0.1, -0.2]\nreaction = ["u2", "u1"]\n', "kappa"),
        ('kappa = 0.1\nreaction = ["u2"]\n', "uses 'u2'"),
    ],
)
def test_what_is_no_reaction_is_refused_in_one_sentence(tmp_path, problem, message):
    with pytest.raises(CpmkitError, match=message) as refused:
        loaded(tmp_path, RUN + problem)
    assert "\n" not in str(refused.value)
