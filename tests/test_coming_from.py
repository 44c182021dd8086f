"""Tables of docs/coming_from/: for each row, the code on the right does what the code on the left does.

`CHECKS` has a function for every row, by the text of its left cell. A row without a function fails.
"""

import inspect
import re
import typing
from pathlib import Path

import gymnasium
import mujoco
import numpy as np
import pytest
import stepper
import stepper.envs
from models import full_mass_matrix
from stepper.envs import Group, Observation, StepperVectorEnv, Task

PAGES = Path(__file__).parents[1] / "docs/coming_from"
SCENE = """<mujoco><option timestep=".002"/><worldbody><geom name="floor" type="plane" size="5 5 .1"/><body name="hand" pos="0 0 .3">
  <freejoint/><geom name="palm" size=".1" mass="1"/><site name="tip" pos=".1 0 0"/><body name="finger" pos=".1 0 0">
  <joint name="j" axis="0 1 0" damping=".1"/>
  <geom name="f" type="capsule" fromto="0 0 0 .2 0 0" size=".02" mass=".2"/></body></body></worldbody>
  <actuator><motor name="m" joint="j" gear="2" ctrlrange="-1 1"/></actuator>
  <sensor><framepos objtype="site" objname="tip"/><jointpos joint="j"/></sensor>
  <keyframe><key name="home" qpos="0 0 .5 1 0 0 0 .3" qvel="0 0 0 0 0 .1 .2" ctrl=".4" time="2"/></keyframe></mujoco>"""


class Pair:
    """Simulations of one model at its keyframe in both engines, with MuJoCo's contact law."""

    def __init__(self):
        self.m = mujoco.MjModel.from_xml_string(SCENE)
        self.m.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
        self.d = mujoco.MjData(self.m)
        mujoco.mj_resetDataKeyframe(self.m, self.d, 0)
        mujoco.mj_forward(self.m, self.d)
        self.model = stepper.load(self.m)
        self.sim = stepper.Stepper(self.model, options=stepper.Options.from_model(self.model))
        self.sim.reset(keyframe="home")

    def step(self, count=1):
        mujoco.mj_step(self.m, self.d, count)
        mujoco.mj_forward(self.m, self.d)
        self.sim.step(nstep=count)

    def jacobian(self, call, index):
        found = np.zeros((6, self.m.nv))
        call(self.m, self.d, found[:3], found[3:], index)
        return found


def same(ours, theirs):
    """Equal to 1e-9, the agreement that docs/explanation/mujoco_law.md claims."""
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-9)


def load(two, tmp_path):
    (tmp_path / "scene.xml").write_text(SCENE)
    for source in (tmp_path / "scene.xml", mujoco.MjSpec.from_string(SCENE), two.m):
        assert stepper.load(source).nq == two.m.nq


def step(two, _):
    two.sim.step([0.1], nstep=5)
    two.d.ctrl[:] = 0.1
    mujoco.mj_step(two.m, two.d, 5)
    same(two.sim.qpos, two.d.qpos)


def reset(two, _):
    """The two calls in the right cell do what both functions in the left cell do."""
    to_default, to_keyframe = code_of("mujoco", "`mj_resetData`, `mj_resetDataKeyframe`")
    two.sim.step(nstep=3)
    eval(to_keyframe, {"sim": two.sim})
    for name in ("qpos", "qvel", "ctrl", "time"):
        same(getattr(two.sim, name), getattr(two.d, name))
    eval(to_default, {"sim": two.sim})
    mujoco.mj_resetData(two.m, two.d)
    for name in ("qpos", "qvel", "ctrl", "time"):
        same(getattr(two.sim, name), getattr(two.d, name))


def set_qpos(two, _):
    two.d.qpos[2] = 1.0
    mujoco.mj_forward(two.m, two.d)
    two.sim.set_state(qpos=two.d.qpos)
    same(two.sim.xpos, two.d.xpos)


def xpos(two, _):
    many = stepper.Stepper(two.model, num_envs=2)
    for sim in (two.sim, many):
        sim.reset(keyframe="home")
        position = sim.xpos[..., two.model.body("hand").id, :]
        same(position, np.broadcast_to(two.d.xpos[two.m.body("hand").id], position.shape))
        same(position, sim.read("xpos", "hand"))


def contacts(two, _):
    two.step(400)
    force = np.zeros(6)
    mujoco.mj_contactForce(two.m, two.d, 0, force)
    ours = two.sim.contacts()
    assert len(ours) == two.d.ncon > 0
    # 1 %: forces of the last step there, at the new state here.
    assert ours["force"][0, 0] == pytest.approx(force[0], rel=0.01)


def sensordata(two, _):
    two.step(3)
    same(two.sim.sensordata_ideal, two.d.sensordata)
    assert two.sim.sensordata.shape == two.d.sensordata.shape


def energy(two, _):
    same(two.sim.energy(), two.d.energy)


def applied(two, _):
    two.sim.xfrc_applied[1, :3] = two.d.xfrc_applied[1, :3] = 1.0, 2.0, 3.0
    two.sim.qfrc_applied[6] = two.d.qfrc_applied[6] = 0.2
    two.step()
    same(two.sim.qvel, two.d.qvel)


def jacobians(two, _):
    same(two.sim.jacobian(body="hand"), two.jacobian(mujoco.mj_jacBody, two.m.body("hand").id))
    same(two.sim.jacobian(site="tip"), two.jacobian(mujoco.mj_jacSite, 0))


def dynamics(two, _):
    same(two.sim.mass_matrix(), full_mass_matrix(two.m, two.d))
    two.d.qacc[:] = 1.0
    mujoco.mj_inverse(two.m, two.d)
    same(two.sim.inverse_dynamics(np.ones(two.m.nv)), two.d.qfrc_inverse)


def rays(two, _):
    point, direction = np.array([3.0, 0.0, 2.0]), np.array([0.0, 0.0, -1.0])
    hit = np.zeros(1, np.int32)
    expected = mujoco.mj_ray(two.m, two.d, point, direction, None, 1, -1, hit)
    distances, geoms = two.sim.rays(point[None], direction[None])
    same(distances, [expected])
    assert geoms.tolist() == hit.tolist()


def derivatives(two, _):
    """Within 1e-5 of MuJoCo's differences of 1e-6, whose error has that size."""
    n, nu = 2 * two.m.nv, two.m.nu
    a, b = np.zeros((n, n)), np.zeros((n, nu))
    mujoco.mjd_transitionFD(two.m, two.d, 1e-6, 1, a, b, None, None)
    found = two.sim.linearize()
    np.testing.assert_allclose(found.A, a, rtol=0, atol=1e-5)
    np.testing.assert_allclose(found.B, b, rtol=0, atol=1e-5)


def states(two, _):
    state = two.sim.get_state()
    two.sim.step(nstep=5)
    after = two.sim.qpos.copy()
    two.sim.set_state(state)
    two.sim.step(nstep=5)
    assert np.array_equal(two.sim.qpos, after)


def rollouts(two, _):
    many = stepper.Stepper(two.model, num_envs=3, threads=2)
    assert many.rollout(np.zeros((4, 3, 1)))["qpos"].shape == (4, 3, two.m.nq)


def friction(two, _):
    assert two.model.replace({"geom_friction[*][0]": 0.5}).geom_friction[:, 0].tolist() == [0.5] * 3
    many = stepper.Stepper(two.model, num_envs=2)
    many.randomize({"geom_friction[*][0]": np.array([0.1, 0.2])})
    assert many.randomized["geom_friction"][:, 0, 0].tolist() == [0.1, 0.2]


def command(two, _):
    from stepper.cli.app import application
    from typer.main import get_command

    assert {"view", "train"} <= set(get_command(application()).commands)


def identification(two, _):
    assert callable(stepper.sysid.identify)


MUJOCO = {
    "`MjModel.from_xml_path(path)`": load,
    "`MjData(model)`": lambda two, _: stepper.Stepper(two.model, num_envs=1024),
    "`mj_step(model, data)` with `data.ctrl`": step,
    "`data.qpos[:] = q; mj_forward`": set_qpos,
    "`mj_resetData`, `mj_resetDataKeyframe`": reset,
    '`data.xpos[model.body("hand").id]`': xpos,
    "`data.contact`, `mj_contactForce`": contacts,
    "`data.sensordata`": sensordata,
    "`data.energy`": energy,
    "`data.xfrc_applied`, `data.qfrc_applied`": applied,
    "`mj_jacBody`, `mj_jacSite`": jacobians,
    "`mj_fullM`, `mj_inverse`": dynamics,
    "`mj_multiRay`": rays,
    "`mjd_transitionFD`": derivatives,
    "`mj_getState`, `mj_setState`": states,
    "`mujoco.rollout`, `mujoco.batch`": rollouts,
    "`model.geom_friction[:, 0] = 0.5`": friction,
    "`mujoco.viewer`": command,
    "`mujoco.sysid`": identification,
}


class Reach(Task):
    """A task that observes a noisy velocity."""

    frame_skip: int = 2

    def model(self):
        return stepper.load(SCENE)

    def observations(self):
        return Observation("qpos"), Observation("qvel", noise=0.1)

    def reward(self, now):
        return np.zeros(len(now.qpos)), {"height": now.qpos[:, 2]}

    def reset(self, reset):
        reset.qpos[:, 2] = 0.5


def observation_groups(*_):
    """The critic has no errors, and the policy sees a bias that stays for the episode."""
    rows = (Observation("qpos", bias=0.015),)
    kind = type("Biased", (Reach,), {"observations": lambda self: {"policy": rows, "critic": Group(rows, noise=False)}})
    envs = StepperVectorEnv(kind(), num_envs=2, groups=True)
    errors = [seen["policy"] - seen["critic"] for seen in (envs.reset(seed=0)[0], envs.step(np.zeros((2, 1)))[0])]
    same(errors[0], errors[1])
    assert 0.0 < np.abs(errors[0]).max() < 0.015


def noise_of_an_observation(*_):
    envs = StepperVectorEnv(Reach(), num_envs=64)
    observation, _ = envs.reset(seed=0)
    error = observation[:, 8:] - envs.sim.qvel
    assert 0.05 < np.abs(error).max() <= 0.1


def noise_of_a_sensor(*_):
    class Sensed(Reach):
        def observations(self):
            return (Observation("sensordata"),)

        def sensors(self):
            return stepper.SensorModel({"*": stepper.Transfer(noise_std=0.1, delay=0.0)})

    envs = StepperVectorEnv(Sensed(), num_envs=64)
    observation, _ = envs.reset(seed=0)
    assert 0.05 < (observation - envs.sim.sensordata_ideal).std() < 0.2


def reward_terms(*_):
    envs = StepperVectorEnv(Reach(), num_envs=2)
    envs.reset(seed=0)
    assert envs.step(np.zeros((2, 1)))[4]["height"].shape == (2,)


def methods(*names):
    """Check that a task has these methods or fields."""

    def check(*_):
        assert [name for name in names if not hasattr(Task, name)] == []

    return check


def selection(two, _):
    many = stepper.Stepper(two.model, num_envs=3)
    many.step(nstep=3)
    many.reset(envs=[True, False, False])
    many.reset(envs=[1])
    assert (many.time > 0).tolist() == [False, False, True]


def entity_data(two, _):
    velocity = stepper.sensors.SensorSpec(type="velocimeter", site="tip")
    sim = stepper.Stepper(two.model.with_sensors({"v": velocity}))
    sim.set_state(qvel=[1.0, 0, 0, 0, 0, 0, 0])
    assert sim.body_linvel[1].tolist() == [1, 0, 0]
    same(sim.read("sensordata_ideal", "v"), [1, 0, 0])


def contact_sensors(two, _):
    two.sim.step(nstep=400)
    assert len(two.sim.contacts()) > 0
    assert two.sim.body_contact_force[1, 2] > 0
    sensors = '<sensor><touch site="tip"/><contact body1="hand" data="force"/>'
    assert len(stepper.load(SCENE.replace("<sensor>", sensors)).sensor_names) == 4


def ray_casters(two, _):
    assert callable(two.sim.rays)
    assert callable(stepper.sensors.HeightField.scan)
    assert callable(stepper.sensors.RayFan)


def decimation(*_):
    envs = StepperVectorEnv(Reach(), num_envs=1)
    envs.reset(seed=0)
    envs.step(np.zeros((1, 1)))
    same(envs.sim.time, [2 * envs.sim.timestep])


ISAAC = {
    "`ManagerBasedRlEnv` with a config": methods("model", "reward"),
    "observation manager, `ObservationGroupCfg`": observation_groups,
    "`ObservationTermCfg` with `noise`, `clip`, `scale`, `delay_max_lag`, `history_length`": noise_of_an_observation,
    "`enable_corruption=False`": observation_groups,
    "encoder bias": observation_groups,
    "noise, bias, delay and dropout of a sensor": noise_of_a_sensor,
    "reward manager, terms with weights": reward_terms,
    "termination manager": methods("terminated"),
    "event manager: startup, reset, interval": methods("events"),
    "command manager": methods("commands"),
    "action manager, joint position actions with scale and offset": methods("actions"),
    "actuator configs: delayed PD, DC motor": methods("actuators"),
    "decimation": decimation,
    "`env_ids`": selection,
    "scene, `InteractiveScene`": lambda two, _: stepper.Stepper(two.model, num_envs=4),
    "entity data: `root_lin_vel_w`, `joint_pos`": entity_data,
    "contact sensor": contact_sensors,
    "ray caster, height scan": ray_casters,
    "torch tensors on the GPU": lambda *_: None,  # tests/adapters/test_torch.py, where torch is installed.
    "`play`, `train` scripts with rsl_rl": command,
}


def env(**more):
    return gymnasium.make("stepper/Ant-v5", **more)


def envs(**more):
    return gymnasium.make_vec("stepper/Ant-v5", num_envs=3, **more)


def of_a_batch(*_):
    made = envs().unwrapped
    assert made.sim.num_envs == 3
    assert made.task.frame_skip == 5


def state_of_one(*_):
    one = env().unwrapped
    one.reset(seed=0)
    qpos, qvel = one.sim.qpos + 0.1, one.sim.qvel + 0.1
    one.set_state(qpos, qvel)
    assert np.array_equal(one.sim.qvel, qvel)
    same(one.sim.read("xpos", "torso")[0], one.sim.xpos[0, one.sim.model.body("torso").id])


def wrapped(*_):
    made = gymnasium.wrappers.vector.RecordEpisodeStatistics(envs(autoreset_mode="SAME_STEP", contact="hard"))
    made.reset(seed=0)
    made.step(made.action_space.sample())


GYMNASIUM = {
    '`gymnasium.make("Ant-v5")`': lambda *_: env(),
    '`make_vec("Ant-v5", num_envs=64, vectorization_mode="sync")`': lambda *_: envs(),
    "`AsyncVectorEnv`": lambda *_: envs(threads=0),
    '`envs.call("name")`, `get_attr`, `set_attr`': of_a_batch,
    "`make_vec(..., wrappers=[...])`": wrapped,
    "`make_vec(..., vector_kwargs={...})`": lambda *_: envs(contact="hard"),
    "`env.unwrapped.model`, `.data`": lambda *_: env().unwrapped.sim.model,
    "`env.unwrapped.set_state(qpos, qvel)`": state_of_one,
    "`env.unwrapped.get_body_com(name)`": state_of_one,
    "`MujocoEnv` as base class": methods("model", "observations", "reward"),
    'wrappers, `AutoresetMode`, "final_obs"': wrapped,
    "`RecordVideo`": lambda *_: env(render_mode="rgb_array"),
}
CHECKS: dict[str, dict[str, typing.Any]] = {"mujoco": MUJOCO, "isaac_lab_and_mjlab": ISAAC, "gymnasium": GYMNASIUM}
TITLES = {"mujoco": "## The same program", "isaac_lab_and_mjlab": "## Terms", "gymnasium": ""}


def table(page):
    """Left and right cells of the table of a page that follows its title in `TITLES`."""
    text = (PAGES / f"{page}.md").read_text()
    lines = re.search(r"\n\|[^\n]*\|\n\|---[^\n]*\n((?:\|[^\n]*\n)+)", text[text.index(TITLES[page]) :])
    return [line.removeprefix("| ").removesuffix(" |").split(" | ") for line in lines[1].splitlines()]


def code_of(page, row):
    """Code snippets in the right cell of a row."""
    return re.findall("`([^`]*)`", dict(table(page))[row])


@pytest.mark.parametrize("page", CHECKS)
def test_every_row_has_a_check(page):
    assert [left for left, _ in table(page)] == list(CHECKS[page])


@pytest.mark.filterwarnings("ignore::stepper.ModelWarning")
def test_calls_on_the_mujoco_page_run(tmp_path):
    """Every `sim....`, `model....` and `stepper.load(...)` of the page about MuJoCo is Python that runs."""
    (tmp_path / "scene.xml").write_text(SCENE)
    many = stepper.Stepper(stepper.load(SCENE), num_envs=2)
    names = {
        "path": tmp_path / "scene.xml", "ctrl": np.zeros((3, 2, 1)), "q": np.array([0, 0, 1.0, 1, 0, 0, 0, 0]), "qacc": np.zeros((2, 7)),
        "points": np.zeros((1, 3)), "directions": np.ones((1, 3)), "values": np.ones(2), "state": many.get_state(), "stepper": stepper,
    }  # fmt: skip
    ran = 0
    for row, _ in table("mujoco"):
        for code in code_of("mujoco", row):
            if re.match(r"(sim|model|stepper\.load)\b[.(]", code):
                ctrl = names["ctrl"] if "rollout" in code else names["ctrl"][0]
                eval(code, names | {"sim": many, "model": many.model, "ctrl": ctrl})
                ran += 1
    assert ran > 20


@pytest.mark.parametrize(("page", "row"), [(page, row) for page, checks in CHECKS.items() for row in checks])
@pytest.mark.filterwarnings("ignore::stepper.ModelWarning")
def test_a_row_is_right(page, row, tmp_path):
    CHECKS[page][row](Pair(), tmp_path)


def test_calls_on_the_pages_exist_with_their_keywords():
    """`sim.reset(keyframe="home")`, `stepper.load(path)` and others are public names, and have the arguments that the call names."""
    owners = {"sim": stepper.Stepper, "model": stepper.Model, "stepper": stepper}
    text = "\n".join((PAGES / f"{page}.md").read_text() for page in CHECKS)
    keywords = set()
    for owner, name, arguments in re.findall(r"`(sim|model|stepper)\.(\w+)\(([^`]*)\)`", text):
        parameters = inspect.signature(getattr(owners[owner], name)).parameters
        keywords |= {(owner, name, word, word in parameters) for word in re.findall(r"(\w+)=", arguments)}
    assert [keyword for *keyword, known in sorted(keywords) if not known] == []
    assert len(keywords) > 4
