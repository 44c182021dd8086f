"""What docs/how-to/view_and_film.md shows of pictures and films runs."""

import re
from pathlib import Path

import gymnasium
import stepper.envs  # noqa: F401  the environments are known to Gymnasium by it

PAGE = (Path(__file__).parents[2] / "docs/how-to/view_and_film.md").read_text()


def test_its_films_are_made(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = {"gymnasium": gymnasium}
    snippets = [s for s in re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL) if "RecordVideo" in s]
    assert snippets
    for snippet in snippets:
        exec(compile(snippet, "docs/how-to/view_and_film.md", "exec"), names)
    env = names["env"]
    env.reset(seed=0)
    for _ in range(5):
        env.step(env.action_space.sample())
    env.close()
    assert list(tmp_path.glob("films/*.mp4"))
