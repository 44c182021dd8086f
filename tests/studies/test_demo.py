"""`stepper demo`: a short race of humanoids."""

import json

import pytest
from stepper.lab.demo import Plan, demo

pytest.importorskip("dm_control")


def test_the_demo_prints_the_table_of_all_engines(tmp_path, capsys):
    demo(Plan(num_envs=8, steps=2, rest=1, chunk=1), tmp_path)
    lines = capsys.readouterr().out.splitlines()
    assert [cell.strip() for cell in lines[0].split("|")[2:-1]] == [
        "stepper f64",
        "stepper f32",
        "MuJoCo implicitfast, elliptic",
        "MuJoCo defaults",
    ]
    assert next(line for line in lines if line.startswith("| environments")).split("|")[2:-1] == [" 8 ", " 8 ", " 2 ", " 2 "]
    figures = json.loads((tmp_path / "demo.json").read_text())
    assert figures["engines"]["stepper f64"]["solver_statistics"]["rest"]["env_steps"] == 8
