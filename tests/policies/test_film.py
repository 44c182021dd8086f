"""Films of policies."""

from importlib.util import find_spec
from types import SimpleNamespace

import gymnasium
import numpy as np
import pytest
from stepper import policies
from stepper.cli import main
from stepper.policies import film


class Pictures(gymnasium.Env):
    """An environment of pictures that get brighter, which ends after five actions."""

    metadata = {"render_modes": ["rgb_array"], "render_fps": 10}  # noqa: RUF012
    observation_space, action_space = gymnasium.spaces.Box(0.0, 255.0, (1,)), gymnasium.spaces.Box(-1.0, 1.0, (1,))

    def __init__(self, render_mode=None):
        self.render_mode, self._count = render_mode, 0

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self._count = 0
        return np.zeros(1, np.float32), {}

    def step(self, action):
        self._count += 1
        return np.full(1, self._count, np.float32), 0.0, self._count == 5, False, {}

    def render(self):
        return np.full((64, 64, 3), 40 * self._count, np.uint8)


@pytest.mark.skipif(find_spec("moviepy") is None, reason="moviepy, which writes films, is not installed")
def test_a_film_tells_how_far_it_is(tmp_path):
    if "test/Pictures-v0" not in gymnasium.registry:
        gymnasium.register("test/Pictures-v0", entry_point=Pictures, max_episode_steps=8)
    told = []
    for actions, count in ((3, 3), (300, 5)):
        made = film(np.zeros_like, "test/Pictures-v0", tmp_path / "film.mp4", actions=actions, progress=lambda *given: told.append(given))
        assert made == count
    # The time limit of the environment is 8 actions, and the episode ends after 5.
    assert told == [("film film.mp4", done) for done in (1 / 3, 2 / 3, 1.0, 1 / 8, 2 / 8, 3 / 8, 4 / 8, 1.0)]
    assert (tmp_path / "film.mp4").stat().st_size > 0


def test_the_command_evaluate_films_after_it_has_checked_that_it_can(tmp_path, monkeypatch, capsys):
    """With stand-ins for the parts that render and run, because few machines have OpenGL."""
    calls = []
    policy = SimpleNamespace(environment={})
    monkeypatch.setattr(policies, "load", lambda _: policy)
    monkeypatch.setattr(policies, "differences", lambda *_: [])
    monkeypatch.setattr(policies, "make", lambda *_, **__: None)
    monkeypatch.setattr(policies, "describe", lambda _: {})
    monkeypatch.setattr(policies, "check_film", lambda env, file, **settings: calls.append(("check", env, file, settings)))
    monkeypatch.setattr(policies, "evaluate", lambda *_, **__: calls.append(("run",)) or "return 7")
    monkeypatch.setattr(
        policies, "film", lambda *given, actions, seed, progress, **settings: calls.append(("film", *given, actions, seed, settings))
    )
    file = tmp_path / "run.mp4"
    words = ["evaluate", "policy.npz", "stepper/HalfCheetah-v5", "--film", str(file), "--seed", "3", "--contact", "hard"]
    monkeypatch.setattr("sys.argv", ["stepper", *words])
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 0
    settings = {"contact": "hard"}
    assert calls == [
        ("check", "stepper/HalfCheetah-v5", file, settings),
        ("run",),
        ("film", policy, "stepper/HalfCheetah-v5", file, 300, 3, settings),
    ]
    assert capsys.readouterr().out.splitlines() == ["return 7", f"wrote {file}"]
