"""What a step that was not solved says: its worst row, the effort of the solver, and its problem as a file."""

import re
from pathlib import Path

import numpy as np
import pytest
import stepper
from checks import raises
from golden import scenes
from models import mjcf, simulate
from scenes import OVERLAP, SLOT

STACK = mjcf("overlapping_boxes")
HINGE = mjcf("hinge_beyond_its_range")
SQUEEZED = SLOT.format(half=0.11)
"""Block that overlaps the walls on both of its sides by a centimetre."""

BLOCKED = OVERLAP.format(joint='axis="0 1 0"')

OUT_OF_REACH = mjcf("connect_out_of_reach")
"""A body on a hinge with a pin, whose anchor in the world `model.replace` may move out of reach."""
FRAGILE = mjcf("fragile")


def stack(**options) -> stepper.Stepper:
    """A heavy box on a light one on the floor."""
    return stepper.Stepper(stepper.load(STACK), options=stepper.Options(timestep=5e-3, **options))


def test_an_unsolved_step_names_its_worst_row():
    sim = stack(solver="pgs", iterations=1)
    assert sim.worst_row() is None
    sim.step(nstep=20)
    assert sim.status & stepper.Status.NOT_CONVERGED
    assert sim.worst_row() in {
        'contact of geom "floor" and geom "low"', 'contact of geom "low" and geom "floor"',
        'contact of geom "low" and geom "high"', 'contact of geom "high" and geom "low"',
    }  # fmt: skip
    raises(IndexError, "must be below 1", sim.worst_row, 1)


def test_a_solved_step_has_no_worst_row():
    sim = stack()
    sim.step(nstep=20)
    assert not sim.status & stepper.Status.NOT_CONVERGED
    assert sim.worst_row() is None


@pytest.mark.parametrize(("scene", "stabilization"), [(SQUEEZED, "split"), (BLOCKED, "split"), (BLOCKED, "baumgarte")])
def test_an_infeasible_step_has_a_residual_and_names_its_row(scene, stabilization):
    """The residual is at least the smallest unmet target that counts as infeasible, 1 cm/s, and at most the largest target, 1 m/s."""
    sim = simulate(scene, stabilization=stabilization, steps=1)
    assert sim.status & stepper.Status.INFEASIBLE and not sim.status & stepper.Status.NOT_CONVERGED
    assert 1e-2 < sim.residual <= 1.0 + 1e-9
    assert re.fullmatch(r'contact of geom "\w+" and geom "\w+"', sim.worst_row())


def test_an_equality_out_of_reach_is_named():
    model = stepper.load(OUT_OF_REACH)
    sim = simulate(model.replace(eq_data=far_anchor(model)), steps=3)
    assert sim.status & stepper.Status.INFEASIBLE
    assert sim.worst_row() == 'equality "pin"' and sim.residual > 1e-2


def far_anchor(model: stepper.Model) -> np.ndarray:
    """Data of the pin with an anchor in the world that is 0.4 m farther from the hinge than the body's."""
    data = np.array(model.eq_data, float)
    data[0, 3:6] += [0.4, 0.0, 0.0]
    return data


def test_a_rejected_step_has_an_infinite_residual_and_names_its_cause():
    """Each of the inputs of an environment may be NaN; the other environment keeps its own residual, and has no cause."""
    model = stepper.load(FRAGILE)

    def control(sim):
        sim.step(np.array([[np.nan], [0.0]]))

    def force(sim):
        sim.xfrc_applied[0, model.body("box").id, 2] = np.nan
        sim.step()

    def generalized(sim):
        sim.qfrc_applied[0, 0] = np.inf
        sim.step()

    def pose(sim):
        sim.mocap_pos[0, 0, 1] = np.nan
        sim.step()

    def speed(sim):
        sim.set_state(qvel=[1e200] * 7, envs=[0])
        sim.step(nstep=5)

    causes = {
        control: 'actuator "servo"',
        force: 'body "box"',
        generalized: 'joint "elbow"',
        pose: 'body "hand"',
        speed: 'joint "(root|elbow)"',
    }
    for contact in ("hard", "mujoco"):
        for act, cause in causes.items():
            sim = stepper.Stepper(model, num_envs=2, options=stepper.Options(contact=contact, integrator="euler"))
            act(sim)
            assert sim.status[0] & stepper.Status.NON_FINITE and not sim.status[1] & stepper.Status.NON_FINITE
            assert np.isinf(sim.residual[0]) and sim.residual[1] < 1e-6
            # Bodies without a common constraint are rejected one by one, so that either joint may be the first.
            assert re.fullmatch(f"number that is not finite: {cause}", sim.worst_row(0)) and sim.worst_row(1) is None


def test_iterations_include_newton_steps():
    swept, both = stack(solver="pgs"), stack(solver="newton")
    swept.step()
    both.step()
    assert swept.iterations > 0 and swept.newton_steps == 0
    assert both.iterations > both.newton_steps > 0
    for sim in (swept, both):
        assert isinstance(sim.iterations, int) and isinstance(sim.newton_steps, int)


def test_a_problem_is_left_as_a_file_and_nothing_changes(tmp_path: Path):
    sim = stack(solver="pgs", iterations=1)
    sim.step(nstep=20)
    before = sim.get_state()
    sim.save_problem(tmp_path / "stack.problem")
    again = tmp_path / "again.problem"
    sim.save_problem(again)
    written = again.read_bytes()
    assert written.startswith(b"problem\xff") and written == (tmp_path / "stack.problem").read_bytes()
    assert [path.name for path in sorted(tmp_path.iterdir())] == ["again.problem", "stack.problem"]
    sim.step()
    after = sim.qpos.copy()
    sim.set_state(before)
    sim.step()
    assert np.array_equal(sim.qpos, after)


def test_the_problem_of_an_environment_is_that_of_its_controls(tmp_path: Path):
    driven = HINGE.replace("</mujoco>", '<actuator><motor joint="elbow"/></actuator></mujoco>')
    sim = simulate(driven, num_envs=3, qpos=np.array([[0.0], [1.0], [1.0]]))

    def problem(env: int, ctrl=None) -> bytes:
        sim.save_problem(tmp_path / "hinge.problem", env, ctrl=ctrl)
        return (tmp_path / "hinge.problem").read_bytes()

    assert problem(1) == problem(2)
    assert problem(0) != problem(1)
    assert problem(1, np.ones(1)) != problem(1)
    assert problem(1, np.array([[0.0], [1.0], [0.0]])) == problem(2, np.ones((3, 1)))
    raises(IndexError, "must be below 3", problem, 3)


def test_a_file_that_cannot_be_written_is_an_error_that_names_it(tmp_path: Path):
    with pytest.raises(OSError, match=r"nowhere.*a\.problem cannot be written .*choose a folder that exists"):
        stack().save_problem(tmp_path / "nowhere" / "a.problem")


@pytest.mark.parametrize(("word", "text"), [
    (0, "Status.OK"),
    (64, "Status.DEEP"),
    (96, "Status.INFEASIBLE | Status.DEEP"),
    (4096, "4096"),
    (4096 + 32, "Status.INFEASIBLE | 4096"),
])  # fmt: skip
def test_flags_print_their_names(word, text):
    flags = stepper.Status(word)
    assert stepper.Status(np.uint32(word)) == flags
    assert str(flags) == f"{flags}" == text
    assert f"{flags:d}" == str(word)
    if word < 4096:
        assert eval(text, {"Status": stepper.Status}) == flags


@pytest.mark.parametrize("error", [None, 1e-3])
def test_an_unsolved_part_of_a_divided_step_is_named(error):
    """One sweep does not solve some impacts, which divide steps. The parts after them are solved."""
    model = scenes.bouncing()
    options = stepper.Options(iterations=1, solver="pgs", error=error)
    sim, rng, unsolved = stepper.Stepper(model, 32, options=options), np.random.default_rng(0), 0
    sim.set_state(model.qpos0 + rng.uniform(-0.05, 0.05, (32, model.nq)), rng.uniform(-1, 1, (32, model.nv)))
    for _ in range(150):
        sim.step()
        for env in np.flatnonzero(sim.status & stepper.Status.NOT_CONVERGED):
            assert sim.worst_row(int(env)) is not None
            unsolved += 1
    assert unsolved > 10
