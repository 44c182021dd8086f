"""The golden trajectories: every feature of the step in both precisions, under every integrator, solver and stabilisation.

Numbers of environments are odd, so that the last group of lanes has some that are none; nineteen and thirty-five environments are more than
the widest group of lanes has in double and in single precision.
"""

from functools import partial

import numpy as np
import stepper
from equalities import KINDS, LINKAGE
from fuzz.scenes import ROBOT, SCENES
from meadow import FIELDS, MEADOW
from models import stepper_model
from stepper import ActuatorModel, Drive, SensorModel, Transfer
from stepper.actuators import PID, DCMotor

from golden import scenes
from golden.record import Random, Trajectory

WIDE, WIDE_F32 = 19, 35


def robot(name: str, **settings) -> Trajectory:
    """A robot that others wrote, thrown about with random controls."""
    return Trajectory(model=partial(stepper_model, name), **settings)


def scene(text: str, **settings) -> Trajectory:
    """A scene of MJCF."""
    return Trajectory(model=partial(stepper.load, text), **settings)


def push(sim: stepper.Stepper, random: Random, call: int) -> None:
    """Forces on joints and on bodies, new ones every tenth call, and none in the last calls."""
    if call % 10 == 0:
        size = 2.0 if call < 40 else 0.0
        sim.qfrc_applied[:] = random.uniform(-size, size, sim.qfrc_applied.shape)
        sim.xfrc_applied[:] = random.uniform(-size, size, sim.xfrc_applied.shape)


def carry(sim: stepper.Stepper, random: Random, call: int) -> None:
    """Mocap bodies on their way, which turn as they go."""
    sim.mocap_pos[:] += random.uniform(-1, 1, sim.mocap_pos.shape) * 0.002 + 0.001
    sim.mocap_quat[:] += random.uniform(-0.01, 0.02, sim.mocap_quat.shape)


def turn(sim: stepper.Stepper, random: Random, call: int) -> None:
    """A mocap body that turns about the vertical."""
    sim.mocap_quat[..., 3] += 0.004
    sim.mocap_quat[..., 0] -= 0.004 * sim.mocap_quat[..., 3]


def interrupt(sim: stepper.Stepper, random: Random, call: int) -> np.ndarray | None:
    """Episodes that end in some environments, states that are set, kept and copied, and a control that is no number."""
    mask = random.uniform(0, 1, sim.num_envs) < 0.4
    if call == 10:
        sim.reset(mask, seed=5)
    if call == 20:
        sim.reset(mask, keyframe=0)
    if call == 25:
        sim.set_state(qvel=random.uniform(-1, 1, sim.qvel.shape), envs=mask)
    if call == 30:
        sim.set_state(qvel=sim.qvel * 0.5, envs=mask, keep_warmstart=True)
    if call == 35:
        sim.set_state(sim.get_state(env=1), envs=mask)
    if call == 40:
        sim.rollout(random.uniform(-1, 1, (4, *sim.ctrl.shape)), nstep=3)
    if call != 45:
        return None
    ctrl = random.uniform(-1, 1, sim.ctrl.shape)
    ctrl[-1] = np.nan
    return ctrl


def randomize(sim: stepper.Stepper, random: Random) -> None:
    """Every parameter that environments may have of their own."""
    model, n = sim.model, sim.num_envs
    sim.randomize(**{name: draw(model, n, random) for name, draw in FIELDS.items()})
    sim.randomize(np.arange(n) % 2 == 0, geom_friction=None, gravity=FIELDS["gravity"](model, n, random))


def redraw(sim: stepper.Stepper, random: Random, call: int) -> None:
    """Numbers of drives that change while they run."""
    if call == 25:
        n = sim.num_envs
        delay, kp = random.uniform(0, 0.006, n), random.uniform(5, 30, n)
        sim.randomize(actuators=ActuatorModel({"elbow": Drive(delay=delay, servo=PID(kp=kp, kd=0.3, ki=2.0), lag=0.02)}))
    if call == 40:
        sim.randomize(np.arange(sim.num_envs) % 3 == 0, actuators=drives(sim.num_envs))
    if call == 60:
        sim.randomize(actuators=None)


def spread(low: float, high: float, num_envs: int) -> np.ndarray:
    """A number for every environment."""
    return low + (high - low) * np.arange(num_envs) / num_envs


def drives(n: int) -> ActuatorModel:
    """A motor with a curve behind a delay, a digital servo with an integral, a lag and friction."""
    motor = DCMotor(stall_torque=spread(0.5, 2, n), no_load_speed=40.0, rotor_inertia=1e-4, gear=2.0, efficiency=0.8)
    return ActuatorModel({
        "shoulder": Drive(delay=spread(0, 0.013, n), motor=motor, friction=0.05, lag=spread(0.002, 0.02, n)),
        "elbow": Drive(delay_steps=3.5, servo=PID(kp=spread(10, 40, n), kd=0.5, ki=5.0, integral_limit=2.0), lag=0.01),
        "wrist": Drive(servo=PID(kp=5.0, kd=0.1, period=0.007), motor=DCMotor(stall_torque=1.0, no_load_speed=30.0, control="voltage"),
                       limits=(-2.0, spread(0.5, 2, n))),
    })  # fmt: skip


def errors(n: int) -> SensorModel:
    """Every error that a sensor may have."""
    return SensorModel(
        {
            "shoulder": Transfer(quantum=0.001, delay=0.0031, jitter=0.001),
            "elbow": Transfer(period=0.007, dropout=0.2, noise="uniform", noise_std=0.05 / np.sqrt(3.0)),
            "gyro": Transfer(noise_density=0.01, bias_std=0.1, drift_std=0.2, drift_time=0.5, limits=(-3.0, 3.0)),
            "accelerometer": Transfer(scale_std=0.03, misalignment_std=0.02, bias=spread(-0.1, 0.1, n), drift_std=0.5),
            "pose": Transfer(noise_std=0.02, bias_std=0.05),
        },
        default=Transfer(scale=1.02, noise_std=0.01),
    )


HUMANOID = "dm_control/humanoid"
EVERYTHING = SCENES[ROBOT]
BAUMGARTE = {"stabilization": "baumgarte"}
EULER, IMPLICIT, RK4 = ({"integrator": name} for name in ("euler", "implicit", "rk4"))
NEWTON, PGS = ({"solver": name} for name in ("newton", "pgs"))
SOFT = {"contact": "mujoco"}
BLUR = Transfer(noise_std=0.02, bias_std=0.05, delay=0.003, drift_std=0.1)
GEARED = Drive(motor=DCMotor(stall_torque=2.0, no_load_speed=50.0, rotor_inertia=1e-4, gear=3.0), lag=0.01)
BOUNDED = {"actuators": ActuatorModel(default=Drive(limits=(-3.0, 2.0), delay=0.003))}
INSTRUMENTED = {"num_envs": 7, "settings": {"actuators": drives(7), "sensors": errors(7), "seed": 3}}

TRAJECTORIES: dict[str, Trajectory] = {
    # Robots.
    "humanoids": robot(HUMANOID, num_envs=WIDE),
    "humanoids-euler": robot(HUMANOID, options=EULER | BAUMGARTE),
    "humanoids-implicit": robot(HUMANOID, options=IMPLICIT),
    "humanoids-rk4": robot(HUMANOID, options=RK4, num_envs=9),
    "humanoids-f32": robot(HUMANOID, num_envs=WIDE_F32, precision="f32", calls=40),
    "humanoids-f32-rk4": robot(HUMANOID, num_envs=11, precision="f32", options=RK4),
    "humanoid-alone": robot(HUMANOID, num_envs=None),
    "humanoid-alone-f32": robot(HUMANOID, num_envs=None, precision="f32", options=IMPLICIT | BAUMGARTE),
    "humanoids-on-two-threads": robot(HUMANOID, num_envs=21, settings={"threads": 2}, calls=40),
    "humanoids-pushed": robot(HUMANOID, options={"stabilization": "none"}, act=push),
    "dogs": robot("dm_control/dog", num_envs=3, calls=20, offset=0.02),
    "quadrupeds": robot("dm_control/quadruped"),
    "quadrupeds-f32": robot("dm_control/quadruped", num_envs=17, precision="f32", options=EULER),
    "ants": robot("gymnasium/ant", num_envs=WIDE, offset=0.2),
    "cheetahs-f32": robot("gymnasium/half_cheetah", num_envs=7, precision="f32", options=IMPLICIT),
    "hoppers-newton": robot("dm_control/hopper", options=NEWTON, offset=0.2),
    "fish": robot("dm_control/fish", options=IMPLICIT),
    "swimmers": robot("gymnasium/swimmer", options=RK4, num_envs=3),
    "stackers-f32": robot("dm_control/stacker", num_envs=WIDE, precision="f32"),
    "humanoids-cmu": robot("dm_control/humanoid_CMU", num_envs=3, calls=50),
    "manipulators": robot("dm_control/manipulator", num_envs=9),
    # MuJoCo's contact law.
    "humanoids-soft": robot(HUMANOID, num_envs=WIDE, options=SOFT),
    "humanoids-soft-f32": robot(HUMANOID, num_envs=WIDE_F32, precision="f32", options=SOFT, calls=40),
    "ants-soft-rk4": robot("gymnasium/ant", num_envs=9, options=SOFT, offset=0.2),
    "quadrupeds-soft-implicitfast": robot("dm_control/quadruped", options=SOFT | {"integrator": "implicitfast"}),
    "pile-soft": scene(scenes.PILE, num_envs=WIDE, options=SOFT, nstep=4),
    "pile-soft-f32": scene(scenes.PILE, num_envs=3, precision="f32", options=SOFT, nstep=4),
    "equalities-soft-law": scene(LINKAGE.format(equality=KINDS["all at once"]), options=SOFT, offset=0.02),
    "everything-soft": scene(EVERYTHING, options=SOFT | {"integrator": "rk4"}),
    # Contacts.
    "pile": scene(scenes.PILE, num_envs=WIDE, nstep=4),
    "pile-euler": scene(scenes.PILE, options=EULER | BAUMGARTE, nstep=4),
    "pile-newton": scene(scenes.PILE, options=NEWTON, num_envs=3, nstep=4),
    "pile-f32": scene(scenes.PILE, num_envs=WIDE_F32, precision="f32", nstep=4),
    "pile-implicit-f32": scene(scenes.PILE, precision="f32", options=IMPLICIT | NEWTON, nstep=4),
    "pile-alone": scene(scenes.PILE, num_envs=None, nstep=4),
    "pile-without-room": scene(scenes.PILE, options={"max_contacts": 5}, nstep=4),
    "tower": scene(scenes.tower(), num_envs=WIDE, offset=0.002, speed=0.1),
    "tower-sweeps": scene(scenes.tower(), options=PGS | {"iterations": 30, "tolerance": 1e-8}, offset=0.002, speed=0.1),
    "tower-f32": scene(scenes.tower(), num_envs=7, precision="f32", options=NEWTON, offset=0.002, speed=0.1),
    "hills": scene(scenes.hills(), nstep=4),
    "hills-f32": scene(scenes.hills(), num_envs=WIDE, precision="f32", options=EULER, nstep=4),
    "ravine": Trajectory(model=scenes.ravine, nstep=4),
    "ravine-f32": Trajectory(model=scenes.ravine, num_envs=3, precision="f32", options=BAUMGARTE, nstep=4),
    "sprung": Trajectory(model=scenes.sprung, num_envs=WIDE, nstep=4),
    "sprung-euler-f32": Trajectory(model=scenes.sprung, num_envs=5, precision="f32", options=EULER, nstep=4),
    "sprung-newton": Trajectory(model=scenes.sprung, num_envs=3, options=NEWTON, nstep=4),
    "sprung-soft": Trajectory(model=scenes.sprung, num_envs=3, options=SOFT, nstep=4),
    "bouncing": Trajectory(model=scenes.bouncing, num_envs=7, nstep=4),
    "bouncing-euler-f32": Trajectory(model=scenes.bouncing, num_envs=7, precision="f32", options=EULER, nstep=4),
    "elastic": Trajectory(model=scenes.elastic, num_envs=WIDE, offset=0.2, speed=3, calls=100),
    "gems": scene(scenes.gems(), nstep=4),
    "gems-f32": scene(scenes.gems(), num_envs=WIDE, precision="f32", options=BAUMGARTE, nstep=4),
    "coins": scene(scenes.coins(), offset=0.005, speed=0.3),
    "marbles": scene(scenes.marbles(), num_envs=3, offset=0.01, speed=0.5, calls=40, nstep=3),
    "shell": Trajectory(model=scenes.shell, nstep=4),
    "belts": scene(scenes.BELTS, act=turn, calls=80),
    "belts-implicit": scene(scenes.BELTS, options=IMPLICIT | BAUMGARTE, act=turn, calls=80),
    "jam": scene(scenes.JAM, num_envs=7, offset=0.01),
    "jam-euler-f32": scene(scenes.JAM, num_envs=7, precision="f32", options=EULER | BAUMGARTE, offset=0.01),
    "thin-wall": scene(scenes.WALL, num_envs=9, offset=0.1, speed=60, nstep=1, calls=20),
    "whirl": scene(scenes.WHIRL, num_envs=9, speed=60),
    "whirl-euler": scene(scenes.WHIRL, num_envs=9, speed=20, options=EULER),
    # Joints, tendons, equalities, drives, sensors.
    "spinning": scene(scenes.SPINNING, speed=20, num_envs=3),
    "spinning-rk4": scene(scenes.SPINNING, speed=20, options=RK4, num_envs=3),
    "spinning-f32": scene(scenes.SPINNING, speed=20, options=IMPLICIT, precision="f32", num_envs=3),
    "fluid": scene(scenes.FLUID, speed=3),
    "fluid-implicit-f32": scene(scenes.FLUID, speed=3, options=IMPLICIT, precision="f32"),
    "tendons": scene(scenes.TENDONS, offset=0.3, speed=3),
    "tendons-implicit": scene(scenes.TENDONS, offset=0.3, speed=3, options=IMPLICIT | NEWTON),
    "tendons-euler-f32": scene(scenes.TENDONS, offset=0.3, speed=3, options=EULER, precision="f32"),
    "equalities": scene(LINKAGE.format(equality=KINDS["all at once"]), offset=0.02),
    "equalities-euler": scene(LINKAGE.format(equality=KINDS["all at once"]), options=EULER | BAUMGARTE, offset=0.02),
    "equalities-f32": scene(LINKAGE.format(equality=KINDS["twice the same"] + KINDS["joint"]), precision="f32", offset=0.02),
    "equalities-soft": Trajectory(model=scenes.soft_linkage),
    "equalities-soft-implicit-f32": Trajectory(model=scenes.soft_linkage, options=IMPLICIT, precision="f32"),
    "welds-carried": scene(LINKAGE.format(equality=KINDS["weld to a mocap body"] + KINDS["weld with a pose and a scale"]), act=carry),
    "sites-connected": scene(LINKAGE.format(equality=KINDS["connect of sites"] + KINDS["tendon"]), options=IMPLICIT),
    "actuators": scene(scenes.every_actuator()),
    "actuators-euler": scene(scenes.every_actuator(), options=EULER | {"timestep": 2e-5}),
    "actuators-rk4": scene(scenes.every_actuator(), options=RK4 | {"timestep": 2e-4}),
    "actuators-bounded": scene(scenes.every_actuator(), settings=BOUNDED),
    "actuators-bounded-rk4-f32": scene(scenes.every_actuator(), settings=BOUNDED, options=RK4 | {"timestep": 1e-4}, precision="f32"),
    "actuators-implicit-f32": scene(scenes.every_actuator(), options=IMPLICIT, precision="f32"),
    "sensors": Trajectory(model=scenes.instrumented, num_envs=9),
    "sensors-with-errors": Trajectory(model=scenes.instrumented, settings={"sensors": SensorModel(default=BLUR), "seed": 9}),
    "sensors-rk4-f32": Trajectory(model=scenes.instrumented, options=RK4, precision="f32"),
    "arm": scene(scenes.ARM, act=redraw, control=2, **INSTRUMENTED),
    "arm-euler": scene(scenes.ARM, act=redraw, control=2, options=EULER | BAUMGARTE, **INSTRUMENTED),
    "tendons-driven": scene(scenes.TENDONS, offset=0.3, speed=3, settings={"actuators": ActuatorModel({"#0": GEARED})}),
    "arm-implicit-f32": scene(scenes.ARM, act=redraw, control=2, options=IMPLICIT, precision="f32", **INSTRUMENTED),
    "arm-without-drives": scene(scenes.ARM, control=2, act=push),
    # Everything at once.
    "everything": scene(EVERYTHING, num_envs=7, act=interrupt),
    "everything-euler": scene(EVERYTHING, num_envs=7, act=interrupt, options=EULER | PGS),
    "everything-carried-f32": scene(EVERYTHING, num_envs=5, act=carry, precision="f32"),
    "everything-alone": scene(EVERYTHING, num_envs=None, options=RK4),
    "meadow": scene(MEADOW),
    "meadow-tuned": scene(MEADOW, options={"baumgarte": 0.5, "slop": 1e-3, "max_correction_speed": 0.1, "restitution_threshold": 0.2}),
    "meadow-within-an-error": scene(MEADOW, options={"error": 1e-4}),
    "meadow-beyond-an-error-f32": scene(MEADOW, options={"error": 1e-9}, precision="f32"),
    "meadow-randomized": scene(MEADOW, num_envs=11, prepare=randomize),
    "meadow-randomized-f32": scene(MEADOW, num_envs=WIDE, prepare=randomize, precision="f32", options=IMPLICIT),
}
