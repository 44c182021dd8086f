"""Report of `stepper demo`."""

from dataclasses import asdict

import stepper
from stepper.lab.demo.report import _notes


def test_the_report_names_the_integrator_of_the_default_options():
    """An integrator of None is the midpoint rule with hard contact."""
    figures = {
        "plan": {"steps": 5, "hold": 1, "seed": 0, "rest": 5, "chunk": 5, "peers": 1},
        "engines": {"stepper": {"options": asdict(stepper.Options()) | {"tolerance": 1e-4}, "timestep": 0.005}},
        "provenance": {"versions": {"stepper": "0", "mujoco-core": "4"}, "cpu": "", "load_average": 0.0, "cpu_levels": ["avx2"]},
        "model": "humanoid",
        "core": 0,
        "num_cores": 1,
    }
    text = "\n".join(_notes(figures))
    assert "integrator midpoint" in text
    assert "None" not in text
