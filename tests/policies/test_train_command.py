"""`stepper train` without PyTorch: what it prints first, and the remedy; and the check of a film before a training."""

import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace

import gymnasium
import numpy as np
import pytest
from checks import raises
from stepper import policies
from stepper.adapters.native import make_native
from stepper.cli import main
from stepper.policies import check_film, film, make, ppo_settings
from stepper.shared.arguments import literal

ROOT = Path(__file__).parents[2]
WITHOUT_TORCH = "import sys; sys.modules['torch'] = None; "
COMMAND = "from stepper.cli import main; sys.argv = ['stepper', 'train', 'stepper/Hopper-v5', '--seed', '3']; main()"
EXAMPLE = f"import runpy; runpy.run_path({str(ROOT / 'examples/train.py')!r}, run_name='__main__')"
LEARNER = f"import runpy; runpy.run_path({str(ROOT / 'python/stepper/policies/ppo.py')!r}, run_name='__main__')"
REACHER = "stepper/Reacher-v5"


@pytest.mark.skipif(find_spec("typer") is None, reason="typer, which the command line needs, is not installed")
def test_the_command_says_what_it_does_before_it_imports_pytorch():
    ended = subprocess.run([sys.executable, "-c", WITHOUT_TORCH + COMMAND], capture_output=True, text=True, check=False)
    assert ended.stdout == "stepper train: importing PyTorch\n"
    assert ended.stderr == 'stepper: torch is needed to train, and is not installed: pip install "stepper-sim[train]"\n'
    assert ended.returncode == 1


@pytest.mark.skipif(find_spec("typer") is None, reason="typer, which the command line needs, is not installed")
@pytest.mark.parametrize(("option", "code", "said"), [("--help", 0, "--minibatch"), ("--minibach", 2, "--minibach")])
def test_help_and_wrong_options_need_no_pytorch(option, code, said):
    ended = subprocess.run(
        [sys.executable, "-c", WITHOUT_TORCH + COMMAND.replace("--seed", option)], capture_output=True, text=True, check=False
    )
    assert ended.returncode == code
    assert said in ended.stdout + ended.stderr
    assert "usage: stepper train" in ended.stdout + ended.stderr
    assert "PyTorch" not in ended.stdout


@pytest.mark.skipif(find_spec("typer") is None, reason="typer, which the command line needs, is not installed")
def test_copy_needs_no_pytorch(tmp_path):
    copy = tmp_path / "mine.py"
    code = WITHOUT_TORCH + COMMAND.replace("'--seed', '3'", f"'--copy', {str(copy)!r}")
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stderr) == (0, "")
    assert copy.read_text() == (ROOT / "python/stepper/policies/ppo.py").read_text()


@pytest.mark.parametrize("script", [EXAMPLE, LEARNER])
def test_scripts_do_too(script):
    """The example, and a copy of the learner."""
    ended = subprocess.run([sys.executable, "-c", WITHOUT_TORCH + script], capture_output=True, text=True, check=False)
    assert "importing PyTorch" in ended.stdout
    assert 'MissingPackageError: torch is needed to train, and is not installed: pip install "stepper-sim[train]"' in ended.stderr


class Dark(gymnasium.Env):
    """An environment without pictures, as on a machine without OpenGL."""

    metadata = {"render_modes": ["rgb_array"], "render_fps": 10}  # noqa: RUF012
    observation_space, action_space = gymnasium.spaces.Box(0.0, 1.0, (1,)), gymnasium.spaces.Box(-1.0, 1.0, (1,))

    def __init__(self, render_mode=None):
        self.render_mode = render_mode

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        return np.zeros(1, np.float32), {}

    def render(self):
        raise RuntimeError("MuJoCo's renderer cannot draw here")


@pytest.mark.skipif(find_spec("moviepy") is None, reason="moviepy, which writes films, is not installed")
def test_a_film_that_cannot_be_drawn_is_refused_before_the_training(tmp_path):
    if "test/Dark-v0" not in gymnasium.registry:
        gymnasium.register("test/Dark-v0", entry_point=Dark)
    raises(RuntimeError, "cannot draw here", check_film, "test/Dark-v0", tmp_path / "film.mp4")


def test_a_film_of_another_format_is_refused_before_the_training():
    raises(ValueError, r"the film's file is 'film\.gif', must end in \.mp4", check_film, "stepper/HalfCheetah-v5", "film.gif")


def test_values_of_the_command_line_are_arguments_of_the_environment():
    words = [REACHER, "--values", "reward_dist_weight=2.5", "--values", "frame_skip=4", "--seed", "3"]
    given = vars(ppo_settings.arguments().parse_args(words))
    settings = ppo_settings.settings_of(given.pop("env"), {name: given[name] for name in ("values", "seed", "gamma")})
    assert settings.environment() == {"precision": "f32", "reward_dist_weight": 2.5, "frame_skip": 4}
    assert make(REACHER, **settings.environment()).unwrapped.task.reward_dist_weight == 2.5
    assert settings.seed == 3
    assert ppo_settings.settings_of(REACHER, {"values": None}) == ppo_settings.Settings.of_task(REACHER)
    gymnasiums = ppo_settings.settings_of("Reacher-v5", {"values": ["reward_dist_weight=2"]})
    assert gymnasiums.environment() == {"reward_dist_weight": 2}


@pytest.mark.parametrize(("values", "message"), [
    (["frame_skip"], "--values is 'frame_skip', must be NAME=VALUE"),
    (["frame_skip=2", "frame_skip=3"], "--values gives 'frame_skip' twice, as 2 and as 3"),
    (["num_envs=8"], "--values sets num_envs: use the option --num-envs instead"),
    (["contact=hard"], "--values sets contact: use the option --contact instead"),
])  # fmt: skip
def test_wrong_values_are_refused(values, message):
    raises(ValueError, message, ppo_settings.settings_of, REACHER, {"values": values})


def test_values_are_numbers_words_tuples_mappings_and_texts():
    texts = {
        "3": 3,
        "0.5": 0.5,
        "true": True,
        "False": False,
        "none": None,
        "(1, 2)": (1, 2),
        "hard": "hard",
        "a.xml": "a.xml",
        '{"pose": 0.5}': {"pose": 0.5},
        "{1}": "{1}",
    }
    assert {text: literal(text) for text in texts} == texts


def test_an_argument_that_an_environment_does_not_have_is_an_error_without_a_traceback(monkeypatch, capsys):
    """Of an environment on stepper and of Gymnasium's; and a text for a number."""
    policy = str(ROOT / "examples/policies/reacher.npz")
    for env, value, message in (
        (REACHER, "reward_dist=2", "takes no 'reward_dist'; did you mean rewards or reward_dist_weight"),
        (REACHER, "frame_skip=two", "frame_skip of Reacher is 'two', must be a number, as the default 2"),
        ("Reacher-v5", "reward_dist=2", "got an unexpected keyword argument 'reward_dist'"),
    ):
        monkeypatch.setattr("sys.argv", ["stepper", "evaluate", policy, env, "--values", value])
        with pytest.raises(SystemExit) as end:
            main()
        assert end.value.code == 1
        assert message in (told := capsys.readouterr().err)
        assert told.startswith("stepper: ")


@pytest.mark.parametrize(("words", "message"), [
    (["stepper/HalfCheetah-v5", "--values", "frame=2"], "takes no 'frame'; did you mean frame_skip"),
    (["tray.xml", "--values", "frame=2"], "--values has no effect on a model, and tray.xml is one"),
])  # fmt: skip
def test_values_of_views_are_arguments_of_environments_alone(words, message, monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["stepper", "view", *words])
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 1
    assert message in capsys.readouterr().err


def test_evaluate_gives_values_to_both_environments(monkeypatch, capsys):
    seen = []
    monkeypatch.setattr(policies, "compare", lambda *_, settings, **__: seen.append(settings) or SimpleNamespace(one=1, other=2))
    words = ["evaluate", str(ROOT / "examples/policies/reacher.npz"), REACHER, "--against", "Reacher-v5"]
    monkeypatch.setattr("sys.argv", ["stepper", *words, "--precision", "f32", "--values", "reward_dist_weight=2"])
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 0, capsys.readouterr().err
    assert seen == [({"precision": "f32", "reward_dist_weight": 2}, {"reward_dist_weight": 2})]


@pytest.mark.parametrize(("env", "remedy"), [
    ("reach_task.py", "write reach_task:me/Name-v0, with the id that the file registers"),
    ("tasks/reach_task.py:me/Reach-v0", "write reach_task:me/Reach-v0, with the id"),
])  # fmt: skip
def test_a_file_in_place_of_an_environment_gets_its_remedy(env, remedy):
    raises(ValueError, f"is a file, must be the id of an environment: {remedy}", make, env)


@pytest.mark.parametrize(("env", "hint"), [
    ("HalfCheetah", "; did you mean stepper/HalfCheetah-v5"),
    ("Go1velocity-v0", "; did you mean stepper/Go1Velocity-v0"),
    ("stepper/HalfChetah-v5", "Did you mean: `HalfCheetah`"),
    ("xyz-v0", "exist"),
])  # fmt: skip
def test_an_unknown_environment_gets_one_hint(env, hint):
    for call in (make, lambda name: make_native(name, 2)):
        with pytest.raises((ValueError, gymnasium.error.Error)) as error:
            call(env)
        told = str(error.value)
        assert hint in told
        assert told.lower().count("did you mean") == (env != "xyz-v0")


# Films of policies.


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
