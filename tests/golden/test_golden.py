"""The bits of some ninety trajectories are those that are kept in the repository, at every CPU level that this machine has.

`golden.json` has two digests of each: of its compiled model, so that another release of MuJoCo, which compiles other numbers, is told apart
from a change of the step, and of all that can be read while it runs (`golden.record`). The final state of the first environment is stored
next to them, so that a change tells how far the trajectory moved. After a change that is meant to change bits:

    PYTHONPATH=tests:tests/helpers .venv/bin/python -m golden --renew

What a build does otherwise than another, the same command says: `--save out/golden` with the one, `--against out/golden` with the other.
"""

import functools

import pytest
import stepper
from stepper.doctor import cpu_levels

from golden import kept
from golden.record import LABELS, READINGS, Record, Trajectory, record
from golden.trajectories import TRAJECTORIES


def test_every_trajectory_is_kept():
    assert list(kept.read()["trajectories"]) == list(TRAJECTORIES)


@pytest.mark.parametrize("level", ["baseline", "avx2", "avx512"])
def test_the_bits_are_those_that_are_kept(level):
    """Of all trajectories at once: they are made together, in a process of that level."""
    if level not in cpu_levels():
        pytest.skip(f"this machine has no {level}, it has {', '.join(cpu_levels())}")
    known, entries = kept.read(), kept.entries_at(level)
    verdicts = {name: kept.verdict(entry, entries[name], known["mujoco"]) for name, entry in known["trajectories"].items()}
    assert {name: verdict for name, verdict in verdicts.items() if verdict} == {}


def test_the_trajectories_have_what_they_are_meant_to_have():
    """Contacts, every flag of a step, both precisions, every method, and numbers of environments that leave lanes empty."""
    entries, flags = kept.read()["trajectories"], stepper.Status(0)
    for entry in entries.values():
        flags |= functools.reduce(lambda a, b: a | stepper.Status[b], entry["flags"].split("|"), stepper.Status(0))
    assert flags == functools.reduce(lambda a, b: a | b, stepper.Status)
    assert len({entry["bits"] for entry in entries.values()}) == len(entries)
    assert sum(entry["contacts"] > 50 for entry in entries.values()) > 40
    settings = list(TRAJECTORIES.values())
    assert {t.precision for t in settings} == {"f64", "f32"}
    options = [stepper.Options(**t.options) for t in settings]
    hard = [(o, t) for o, t in zip(options, settings, strict=True) if o.contact == "hard"]
    assert {(o.integrator or "midpoint", t.precision) for o, t in hard} == {
        (integrator, precision) for integrator in ("euler", "midpoint", "implicit", "rk4") for precision in ("f64", "f32")
    }
    assert {o.solver for o in options} == {"auto", "pgs", "newton"}
    assert {o.stabilization for o in options} == {"split", "baumgarte", "none"}
    assert all(t.num_envs is None or t.num_envs % 2 for t in settings)


@pytest.fixture(scope="module")
def short() -> Record:
    """A trajectory with contacts, sensors and actuators."""
    whole = TRAJECTORIES["everything-carried-f32"]
    return record(Trajectory(model=whole.model, precision=whole.precision, calls=2, offset=0.2))


@pytest.mark.parametrize("name", [*(LABELS.get(name, name) for name in READINGS), "contacts force", "mass matrix"])
def test_one_bit_of_one_reading_is_a_change_of_the_step(short, name):
    entry = short.entry()
    assert kept.verdict(entry, short.entry(), "4") == ""
    places = [k for k, (label, data) in enumerate(short.readings) if label.endswith(f": {name}") and data]
    for place in places:
        label, data = short.readings[place]
        for byte in {0, len(data) // 2, len(data) - 1}:
            changed = bytearray(data)
            changed[byte] ^= 1
            readings = [*short.readings[:place], (label, bytes(changed)), *short.readings[place + 1 :]]
            other = Record(short.model, readings, short.contacts, short.flags)
            assert kept.verdict(entry, other.entry(), "4").startswith("the step changed")
            assert kept.first_difference(short.readings, readings) == label
    assert places


def test_a_reading_that_moves_from_one_name_to_the_next_is_a_change(short):
    (first, data), (second, more), *rest = short.readings
    moved = Record(short.model, [(first, data[:-1]), (second, data[-1:] + more), *rest], short.contacts, short.flags)
    assert moved.bits != short.bits


def test_another_model_is_told_apart_from_another_step(short):
    entry = short.entry()
    other = entry | {"model": "0" * 64}
    assert kept.verdict(entry, other | {"bits": "0" * 64}, "4.9").startswith("the compiled model changed")
    assert "4.9 compiled the one that was kept" in kept.verdict(entry, other | {"bits": "0" * 64}, "4.9")
    assert kept.verdict(entry, other, "4.9").startswith("the step did not change")
    assert kept.verdict(entry, entry | {"contacts": -1}, "4.9").startswith("the counts")
