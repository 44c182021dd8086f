"""Messages of the core and of the crates below it name the calls of Rust, and the bindings say them with Python's."""

import re
from pathlib import Path

import numpy as np
import pytest
import stepper

ROOT = Path(__file__).parents[2]
SOURCES = sorted(path for crate in ("geometry", "model", "core", "derivative") for path in (ROOT / "crates" / crate / "src").rglob("*.rs"))
PYTHON = re.compile(r"Stepper\(|strict=False|=\.\.\.|contact=\\?\"|method='|\bget_state|Options\.|reset\(qpos")


def code(source: str) -> list[str]:
    return [line for line in source.split("#[cfg(test)]", maxsplit=1)[0].splitlines() if not line.lstrip().startswith("//")]


def test_the_core_does_not_speak_python():
    found = [f"{path.relative_to(ROOT)}: {line.strip()}" for path in SOURCES for line in code(path.read_text()) if PYTHON.search(line)]
    assert not found, "\n".join(found)


def test_every_phrase_that_is_translated_is_said():
    phrases = re.findall(r'^    \("((?:[^"\\]|\\.)*)",', (ROOT / "crates/python/src/phrases.rs").read_text(), re.MULTILINE)
    assert len(phrases) > 10
    sources = [re.sub(r"\\\n\s*", "", path.read_text()) for path in SOURCES]
    assert [phrase for phrase in phrases if not any(phrase in source for source in sources)] == []


HINGE = '<mujoco{option}><worldbody><body><joint name="j" type="hinge"/><geom size=".1"/></body></worldbody></mujoco>'


@pytest.mark.parametrize(("call", "message"), [
    (lambda m: stepper.Stepper(m, options=stepper.Options(integrator="discrete")), 'rk4 with contact="hard"'),
    (lambda m: stepper.Stepper(m, 1).randomize(timestep=np.ones(1)), r"make a stepper.Stepper of model\.replace\(timestep=\.\.\.\)"),
    (
        lambda m: stepper.Stepper(m, 1).randomize(jnt_stiffness=np.ones((1, 1))),
        r"with model\.replace\(jnt_stiffness=\.\.\.\), and create the Stepper of that model",
    ),
    (
        lambda m: stepper.Stepper(m, options=stepper.Options(integrator="rk4")).linearize(method="implicit"),
        "for method='implicit'; method='fd' takes all",
    ),
])  # fmt: skip
def test_messages_have_pythons_names(call, message):
    with pytest.raises(ValueError, match=message):
        call(stepper.load(HINGE.format(option="")))


def test_reports_have_pythons_names():
    text = HINGE.format(option="").replace("<worldbody>", '<option integrator="RK4"/><worldbody>', 1)
    with pytest.warns(stepper.ModelWarning, match=r"Options\.from_model\(model\) uses the source's"):
        model = stepper.load(text)
    assert "Options.from_model(model)" in model.explain()
    assert "::" not in model.explain()
