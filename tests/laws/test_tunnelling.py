"""Fast motion: nothing passes through a wall of a millimetre, however fast; where that cannot be excluded, the step says so."""

import mujoco
import numpy as np
import pytest
import stepper
from checks import every
from hypothesis import given, strategies as st
from models import SOURCES, afloat, random_quaternion, simulate

HEAD = '<mujoco><option gravity="0 0 0"/><worldbody>'
TAIL = "</worldbody></mujoco>"
WALL = '<geom type="box" size=".0005 2 2"/>'
BODIES = {
    "sphere": 'type="sphere" size=".05" mass="1"',
    "bullet": 'type="sphere" size=".003" mass="1"',
    "capsule ahead": 'type="capsule" size=".02 .1" euler="0 90 0" mass="1"',
    "capsule across": 'type="capsule" size=".02 .1" mass="1"',
    "leaning capsule": 'type="capsule" size=".02 .1" euler="0 50 20" mass="1"',
}
ENVS = 32
every_dt = pytest.mark.parametrize("dt", [1e-4, 1e-3, 5e-3, 2e-2])
every_integrator = pytest.mark.parametrize("integrator", ["euler", "midpoint", "rk4"])
every_stabilization = pytest.mark.parametrize("stabilization", ["baumgarte", "split"])
BALL = '<body><freejoint/><geom type="sphere" size=".02" mass="1"/></body>'
ROD = '<body><freejoint/><geom type="capsule" size=".01 .08" mass="1"/></body>'
BRICK = '<body><freejoint/><geom type="box" size=".03 .02 .01" mass="1"/></body>'
WALLS = {
    "box": '<geom type="box" size=".002 .3 .3"/>',
    "post": '<geom type="capsule" size=".004 .3"/>',
    "disc": '<geom type="cylinder" size=".3 .002" euler="0 90 0"/>',
}
STIFF = """<mujoco><worldbody><body><joint name="j" axis="0 0 1"/><geom type="capsule" size=".02" fromto="0 0 0 .3 0 0"/></body>
  </worldbody><actuator><position joint="j" kp="1e5"/></actuator></mujoco>"""


@every_stabilization
@every_integrator
@every_dt
@every(body=BODIES, way=[0.011, 0.3, 3.0])
def test_a_wall_stops_what_flies_into_it(body, way, dt, integrator, stabilization):
    """`way` in m per step: eleven walls to three thousand. Every environment meets the wall in another phase of the step."""
    text = HEAD + WALL + f"<body><freejoint/><geom {BODIES[body]}/></body>" + TAIL
    sim = simulate(text, ENVS, timestep=dt, integrator=integrator, stabilization=stabilization)
    speed = way / dt
    qpos, qvel = sim.qpos.copy(), sim.qvel.copy()
    qpos[:, 0] = -0.2 - way * np.linspace(0.0, 2.0, ENVS)
    qvel[:, 0] = speed
    sim.set_state(qpos, qvel)
    touched = np.zeros(ENVS, dtype=bool)
    for _ in range(round(0.5 / way) + 8):
        sim.step()
        touched |= [len(sim.contacts(env)) > 0 for env in range(ENVS)]
        # A leaning capsule is turned by the wall; its middle stays on this side as long as any of it does.
        passed = sim.qpos[:, 0] > 0
        assert not passed.any() or (sim.status[passed] & stepper.Status.TUNNELLED).all()
        if "leaning" not in body:
            assert not passed.any()
            assert not (sim.status & stepper.Status.TUNNELLED).any()
    assert touched.all()


@every_integrator
@every_dt
def test_a_flying_wall_takes_along_what_it_meets(dt, integrator):
    """The sphere stands, the wall flies: the same to an observer on the wall."""
    wall = '<body><joint type="slide" axis="1 0 0"/><geom type="box" size=".0005 2 2" mass="1000"/></body>'
    sim = simulate(HEAD + wall + f"<body><freejoint/><geom {BODIES['sphere']}/></body>" + TAIL, ENVS, timestep=dt, integrator=integrator)
    way = 0.3
    qpos, qvel = sim.qpos.copy(), sim.qvel.copy()
    qpos[:, 0] = -0.2 - way * np.linspace(0.0, 2.0, ENVS)
    qvel[:, 0] = way / dt
    sim.set_state(qpos, qvel)
    for _ in range(12):
        sim.step()
        assert (sim.qpos[:, 1] > sim.qpos[:, 0]).all()
    assert (sim.qvel[:, 1] > 0.9 * way / dt).all()


@every_integrator
@every_dt
@pytest.mark.parametrize("angle", [0.03, 0.3, 1.2])
def test_a_swinging_bar_stops_at_a_post_or_says_that_it_may_not_have(angle, dt, integrator):
    """`angle` in rad per step. The post is a millimetre thick, a radian ahead, and as long as the outer half of the bar."""
    post = '<body euler="0 0 57.29577951308232"><geom type="box" size=".25 .0005 .1" pos=".75 0 0"/></body>'
    bar = '<body><joint axis="0 0 1"/><geom type="capsule" size=".01" fromto=".02 0 0 1 0 0" mass="1"/></body>'
    sim = simulate(HEAD + post + bar + TAIL, ENVS, timestep=dt, integrator=integrator)
    qpos, qvel = sim.qpos.copy(), sim.qvel.copy()
    qpos[:, 0] = -angle * np.linspace(0.0, 1.0, ENVS)
    qvel[:, 0] = angle / dt
    sim.set_state(qpos, qvel)
    suspected = np.zeros(ENVS, dtype=bool)
    for _ in range(int(2.5 / angle)):
        sim.step()
        suspected |= (sim.status & stepper.Status.TUNNELLED) != 0
    assert ((sim.qpos[:, 0] < 1.0) | suspected).all()
    if angle < 0.05:
        assert not suspected.any()


def test_what_is_struck_fast_and_unforeseen_is_reported():
    """A heavy ball drives a light one, which stood still, through the wall behind it within one step: its own velocity foretold nothing."""
    heavy = '<body pos="-.5 0 0"><freejoint/><geom type="sphere" size=".1" mass="100" margin="0"/></body>'
    light = '<body pos="-.3 0 0"><freejoint/><geom type="sphere" size=".02" mass=".01"/></body>'
    sim = simulate(HEAD + WALL + heavy + light + TAIL, timestep=1e-2, integrator="euler")
    qvel = sim.qvel.copy()
    qvel[0] = 100.0
    sim.set_state(qvel=qvel)
    passed = False
    for _ in range(4):
        sim.step()
        passed |= sim.qpos[7] > 0
        assert not passed or sim.status & stepper.Status.TUNNELLED
        if passed:
            break


# TUNNELLED is set where something may have passed through something unseen, and nowhere else. What meets is decided here by MuJoCo's
# distances (`mj_geomDistance`) at two hundred places of the step's path, which shapes take with the velocity after the step from where
# contacts were found.

LAWS = pytest.mark.parametrize("contact", ["hard", "mujoco"])
STEPS = pytest.mark.parametrize("timestep", [1e-3, 2e-3, 5e-3])
POINTS, HALF, HIGH = 33, 2.0, 0.08
TUNNELLED = int(stepper.Status.TUNNELLED)


def quadruped():
    """A robot of a Go1's size whose limbs are balls and capsules, and its servos."""
    legs = "".join(
        f"""<body pos="{x} {y} 0"><joint axis="1 0 0" range="-50 50"/><geom size=".04" mass=".5"/>
        <body><joint axis="0 1 0" range="-40 160"/><geom type="capsule" size=".02" fromto="0 0 0 0 0 -.2" mass=".7"/>
        <body pos="0 0 -.2"><joint axis="0 1 0" range="-160 -50"/><geom type="capsule" size=".012" fromto="0 0 0 0 0 -.18" mass=".2"/>
        <geom size=".023" pos="0 0 -.2" mass=".06"/></body></body></body>"""
        for x in (0.19, -0.19)
        for y in (0.11, -0.11)
    )
    body = f'<body pos="0 0 .45"><freejoint/><geom type="box" size=".2 .08 .05" mass="5"/>{legs}</body>'
    names = [f"j{k}" for k in range(12)]
    for name in names:
        body = body.replace("<joint axis", f'<joint name="{name}" damping=".5" armature=".01" axis', 1)
    servos = "".join(f'<position joint="{name}" kp="40" kv="1" forcerange="-24 24"/>' for name in names)
    return body, f"<actuator>{servos}</actuator>"


def ground(kind, rng):
    """Asset and geom of rough ground."""
    heights = rng.uniform(0, 1, (POINTS, POINTS))
    if kind == "field":
        numbers = " ".join(f"{x:.4f}" for x in heights.ravel())
        return (
            f'<asset><hfield name="t" nrow="{POINTS}" ncol="{POINTS}" size="{HALF} {HALF} {HIGH} .1" elevation="{numbers}"/></asset>',
            '<geom type="hfield" hfield="t"/>',
        )
    if kind == "plane":
        return "", '<geom type="plane" size="5 5 1"/>'
    places, n = np.linspace(-HALF, HALF, POINTS), POINTS
    top = [(x, y, HIGH * heights[r, c]) for r, y in enumerate(places) for c, x in enumerate(places)]
    vertices = top + [(x, y, -0.1) for x, y, _ in top]
    faces = []
    for r in range(n - 1):
        for c in range(n - 1):
            a = r * n + c
            b = a + n * n
            faces += [(a, a + 1, a + n + 1), (a, a + n + 1, a + n), (b, b + n + 1, b + 1), (b, b + n, b + n + 1)]
    for k in range(n - 1):
        for p, q in [(k, k + 1), ((n - 1) * n + k + 1, (n - 1) * n + k), ((k + 1) * n, k * n), (k * n + n - 1, (k + 1) * n + n - 1)]:
            faces += [(p, p + n * n, q + n * n), (p, q + n * n, q)]
    vertices, faces = (" ".join(" ".join(map(str, p)) for p in points) for points in (vertices, faces))
    return f'<asset><mesh name="t" vertex="{vertices}" face="{faces}"/></asset>', '<geom type="mesh" mesh="t"/>'


def is_below(sim, heights):
    """Environments in which the centre of a ball, or an end of a capsule's axis, is below the ground or within a millimetre of it."""
    w, x, y, z = np.moveaxis(sim.geom_xquat[:, 1:], -1, 0)
    axis = np.stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)], axis=-1)
    # Of the trunk, a box, a place within it.
    half = sim.model.geom_size[1:, 1, None] * axis
    ends = sim.geom_xpos[:, 1:, None] + np.array([-1, 0, 1])[:, None] * half[:, :, None]
    at = (ends[..., :2] + HALF) / (2 * HALF) * (POINTS - 1)
    (c, r), (x, y) = np.moveaxis(at.astype(int), -1, 0), np.moveaxis(at % 1, -1, 0)
    beside = np.where(x > y, heights[r, c + 1], heights[r + 1, c])
    first, last = np.maximum(x, y), np.minimum(x, y)
    height = (1 - first) * heights[r, c] + (first - last) * beside + last * heights[r + 1, c + 1]
    return (ends[..., 2] < height + 1e-3).any(axis=(1, 2))


@STEPS
@LAWS
@pytest.mark.parametrize("kind", ["plane", "field", "mesh"])
def test_a_robot_on_rough_ground_does_not_tunnel(kind, contact, timestep):
    """Thirty random actions of 20 ms of eight robots: limbs at up to some m/s, centimetres a step, and nothing passes through anything."""
    # Soft contacts give by centimetres where feet are thrown at the ground. Of a mesh a ball is lost whose centre is behind a triangle:
    # there alone the step may say so.
    rng = np.random.default_rng(0)
    (asset, geom), (body, servos) = ground(kind, rng), quadruped()
    heights = np.random.default_rng(0).uniform(0, HIGH, (POINTS, POINTS))
    source = f'<mujoco><option integrator="implicitfast"/>{asset}<worldbody>{geom}{body}</worldbody>{servos}</mujoco>'
    model = stepper.load(source, strict=False)
    if kind == "mesh":
        model = model.replace(geom_concave=[True] + [False] * (model.ngeom - 1))
    sim = stepper.Stepper(model, 8, options=stepper.Options(contact=contact, timestep=timestep))
    stand, qpos = np.tile([0, 0.9, -1.8], 4), sim.qpos.copy()
    qpos[:, :2], qpos[:, 7:] = rng.uniform(-0.7, 0.7, (8, 2)), stand
    sim.set_state(qpos=qpos)
    fastest = 0.0
    for _ in range(30):
        ctrl = stand + rng.normal(0, 0.6, (8, 12))
        for _ in range(round(0.02 / timestep)):
            sim.step(ctrl)
            flagged = (sim.status & TUNNELLED) != 0
            if kind == "mesh" and flagged.any():
                flagged &= ~is_below(sim, heights)
            assert not flagged.any()
        fastest = max(fastest, np.abs(sim.qvel[:, 6:]).max())
        # The robot is above the ground.
        assert (sim.qpos[:, 2] > 0).all()
    assert fastest > 10.0


def fly(scene, contact, timestep, qpos, qvel):
    """One step of something that flies, without gravity: whether it is flagged, and whether it meets the wall on its way."""
    source = f'<mujoco><option gravity="0 0 0" timestep="{timestep}"/><worldbody>{scene}</worldbody></mujoco>'
    compiled = mujoco.MjModel.from_xml_string(source)
    sim = simulate(compiled, contact=contact, integrator="euler", qpos=qpos, qvel=qvel, steps=1)
    data, meets, towards = mujoco.MjData(compiled), False, np.zeros(6)
    for part in np.linspace(0, 1, 201):
        data.qpos[:] = qpos
        # With the velocity after the step: hard contact stops what it foresees, and may turn it.
        mujoco.mj_integratePos(compiled, data.qpos, sim.qvel, part * timestep)
        mujoco.mj_kinematics(compiled, data)
        meets |= mujoco.mj_geomDistance(compiled, data, 0, 1, 1.0, towards) < 0
    return bool(int(sim.status) & TUNNELLED), meets


@LAWS
@given(
    wall=st.sampled_from(sorted(WALLS)),
    thing=st.sampled_from([BALL, ROD, BRICK]),
    timestep=st.sampled_from([1e-3, 5e-3]),
    seed=st.integers(0, 10**6),
)
def test_nothing_is_flagged_that_does_not_meet(contact, wall, thing, timestep, seed):
    """Things that fly past thin walls, up to half a metre in a step, and turn."""
    rng = np.random.default_rng(seed)
    quat = random_quaternion(rng)
    qpos = np.concatenate([rng.uniform(-0.4, 0.4, 3), quat])
    qvel = np.concatenate([rng.normal(0, 0.25, 3), rng.normal(0, 0.5, 3)]) / timestep
    flagged, meets = fly(WALLS[wall] + thing, contact, timestep, qpos, qvel)
    assert meets or not flagged


@every(thing=["ball", "rod", "brick"], wall=WALLS, timestep=[1e-3, 5e-3])
def test_what_passes_through_unseen_is_flagged(wall, thing, timestep):
    """By MuJoCo's law, which looks ahead of nothing: a tenth of a metre a step, through the middle of a wall of 4 to 8 mm."""
    rng = np.random.default_rng(0)
    for _ in range(10):
        qpos = np.concatenate([[-rng.uniform(0.11, 0.14), 0, 0], random_quaternion(rng)])
        qvel = np.concatenate([[0.27, 0, 0], rng.normal(0, 0.1, 3)]) / timestep
        flagged, meets = fly(WALLS[wall] + {"ball": BALL, "rod": ROD, "brick": BRICK}[thing], "mujoco", timestep, qpos, qvel)
        assert meets and flagged


@pytest.mark.parametrize("kind", ["field", "mesh"])
def test_what_falls_through_rough_ground_unseen_is_flagged(kind):
    """A ball that falls by 0.4 m a step is 0.1 m above the ground before, and below its base after."""
    asset, geom = ground(kind, np.random.default_rng(0))
    model = stepper.load(f'<mujoco><option timestep=".005"/>{asset}<worldbody>{geom}{BALL}</worldbody></mujoco>', strict=False)
    if kind == "mesh":
        model = model.replace(geom_concave=[True, False])
    sim = stepper.Stepper(model, 20, options=stepper.Options(contact="mujoco"))
    rng, qpos, qvel = np.random.default_rng(1), sim.qpos.copy(), sim.qvel.copy()
    qpos[:, :2], qpos[:, 2], qvel[:, 2] = rng.uniform(-1.5, 1.5, (20, 2)), 0.2, -80.0
    sim.set_state(qpos=qpos, qvel=qvel)
    sim.step()
    assert (sim.qpos[:, 2] < -0.15).all()
    assert ((sim.status & TUNNELLED) != 0).all()


def test_a_sphere_through_a_ridge_of_a_field_is_flagged():
    """A ridge of one row of points, 0.1 m high: a ball that flies through it is above the ground before and after."""
    heights = np.zeros((21, 21))
    heights[:, 10] = 1.0
    numbers = " ".join(map(str, heights.ravel()))
    field = f'<hfield name="t" nrow="21" ncol="21" size=".2 .2 .1 .1" elevation="{numbers}"/>'
    source = f"""<mujoco><option timestep=".005" gravity="0 0 0"/><asset>{field}</asset>
      <worldbody><geom type="hfield" hfield="t"/>{BALL}</worldbody></mujoco>"""
    sim = stepper.Stepper(stepper.load(source), 2, options=stepper.Options(contact="mujoco"))
    qpos, qvel = sim.qpos.copy(), sim.qvel.copy()
    qpos[:, 0], qpos[:, 2], qvel[:, 0] = -0.1, [0.05, 0.13], 40.0
    sim.set_state(qpos=qpos, qvel=qvel)
    sim.step()
    assert ((sim.status & TUNNELLED) != 0).tolist() == [True, False]


# Motion that a step is too long for: it is said, and no energy comes of it.


@every(integrator=["midpoint", "implicit"], dt=[0.05, 0.1], name=["dm_control/humanoid", "gymnasium/ant"])
def test_without_input_a_thrown_robot_gains_no_energy(name, dt, integrator):
    """Ten, then a hundred radians a second and more in every joint, no gravity, nothing to touch: limbs whirl by radians in a step."""
    model = afloat(name, gravity=False)
    for speed in (10.0, 100.0):
        sim, rng = simulate(model, timestep=dt, integrator=integrator), np.random.default_rng(5)
        sim.set_state(qvel=rng.normal(scale=speed, size=model.nv))
        start, said = sum(sim.energy()), 0
        for _ in range(200):
            sim.step()
            said |= int(sim.status)
            # Unresolved steps gain nothing; resolved ones have the error of their rule, (h omega)^2 of what is left when they begin.
            assert sum(sim.energy()) < 1.5 * start
        assert said & stepper.Status.UNRESOLVED
        assert not said & stepper.Status.NON_FINITE


@every(integrator=["midpoint", "implicit"], dt=[0.05, 0.1])
def test_a_humanoid_under_random_control_stays_finite(dt, integrator):
    """On the floor, with motors that work on it: no speed beyond what its motors can give it."""
    model = mujoco.MjModel.from_xml_path(str(SOURCES["dm_control/humanoid"]))
    for seed in range(4):
        sim, rng = simulate(model, timestep=dt, integrator=integrator), np.random.default_rng(seed)
        for _ in range(300):
            sim.step(rng.uniform(-1, 1, model.nu))
            assert not sim.status & stepper.Status.NON_FINITE
            # J: 21 motors, most of 40 N m, over the radian or two of a joint's range.
            assert sim.energy()[1] < 5e3


def test_a_fast_wheel_is_no_unresolved_motion():
    """Five radians a step about a fixed axis: no velocity-dependent force, nothing to resolve."""
    text = """<mujoco><worldbody><body><joint type="hinge" axis="0 0 1"/>
      <geom type="cylinder" size=".2 .05"/></body></worldbody></mujoco>"""
    sim = simulate(text, timestep=5e-3, qvel=[1000.0], steps=1000)
    assert sim.status == stepper.Status.OK
    assert sim.qvel[0] == pytest.approx(1000.0, rel=1e-12)


# Hard contact evaluates servos at the end of the step, except with Euler's rule.
@pytest.mark.parametrize(
    ("contact", "integrator"), [("hard", "euler"), *(("mujoco", rule) for rule in ("euler", "implicitfast", "implicit", "rk4"))]
)
def test_an_explicit_servo_that_diverges_is_flagged_before_the_numbers_are_absurd(contact, integrator):
    """h^2 kp / I is 1e3, and a rule that evaluates the servo before the step multiplies the motion by about as much in each."""
    sim = simulate(STIFF, timestep=0.01, integrator=integrator, contact=contact, qpos=[0.01])
    said, largest = 0, 0.0
    while not said & stepper.Status.UNRESOLVED:
        sim.step()
        said, largest = int(sim.status), abs(float(sim.qpos[0]))
        # rad: the first step leads to 7.7, with rk4 to 245. Without a flag, the second would lead to 6e3 or more.
        assert largest < 1e3
    assert largest > 0.01


def test_a_number_beyond_ten_to_the_ten_is_flagged_with_every_law():
    """MuJoCo resets an environment there. A body that slides has no scale of its own that would be too fast."""
    text = '<mujoco><worldbody><body><joint type="slide" axis="1 0 0"/><geom size=".1"/></body></worldbody></mujoco>'
    for contact, integrator in (("hard", "midpoint"), ("hard", "euler"), ("mujoco", "implicitfast")):
        sim = simulate(text, timestep=1e-3, integrator=integrator, contact=contact)
        for position, flagged in ((0.9e10, False), (1.1e10, True)):
            sim.set_state(qpos=[position])
            sim.step()
            assert bool(sim.status & stepper.Status.UNRESOLVED) == flagged
