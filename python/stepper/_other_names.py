"""Tables from names of earlier versions, MuJoCo, Gymnasium and other simulators to the names in stepper.

`stepper._hints` uses them for hints in error messages.
"""

from __future__ import annotations

_WHOLE_BATCH = "attributes and methods of the whole batch, as envs.unwrapped.sim.qpos and envs.unwrapped.task"
_ENVIRONMENT = {
    "data": "sim, as env.unwrapped.sim.qpos",
    "model": "sim.model",
    "physics": "sim",
    "init_qpos": "sim.model.qpos0",
    "init_qvel": "task.sample_state(...), which sets velocities of a new episode",
    "frame_skip": "task.frame_skip",
    "state_vector": "sim.qpos and sim.qvel",
    "get_body_com": "sim.read('xpos', name)",
    "do_simulation": "sim.step(ctrl, nstep)",
    "mujoco_renderer": "render()",
    "reset_model": "reset()",
    "envs": "sim, one stepper with all environments",
    "contacts": "sim.contacts()",
    "call": _WHOLE_BATCH,
    "get_attr": _WHOLE_BATCH,
    "set_attr": _WHOLE_BATCH,
    **{name: f"sim.{name}" for name in ("qpos", "qvel", "xpos", "sensordata", "ctrl", "timestep", "status", "randomize", "time")},
}

RENAMED = {
    "Task": {"quantities": "observations", "start": "sample_state", "prepare": "on_reset", "memory": "episode_state"},
    "Moment": {"memory": "episode_state", "rest": "default_qpos"},
    "stepper.envs": {"Quantity": "Observation", "Draws": "Rng"},
}
"""Current names of methods and attributes of tasks: for each class or module, a table from the earlier name to the current one."""

_TASKS = {
    "tasks": (
        *("Ant", "HalfCheetah", "Hopper", "Humanoid", "HumanoidStandup", "InvertedDoublePendulum", "InvertedPendulum", "Pusher", "Reacher"),
        *("Swimmer", "Walker2d"),
    ),
    "basic": ("FallingBlock", "Grasp"),
    "locomotion": ("G1Rough", "G1Velocity", "Go1Rough", "Go1Velocity", "VelocityTask"),
    "suite": ("SUITE",),
}
"""Names that users may look for in `stepper.envs` itself, by the submodule of `stepper.envs` that has them."""

NEW_NAMES: dict[str, dict[str, str]] = {
    **RENAMED,
    "stepper.envs": {
        **RENAMED["stepper.envs"],
        **{name: f"stepper.envs.{place}.{name}" for place, names in _TASKS.items() for name in names},
    },
    "Options": {"of": "from_model"},
    "selector": {"drive": "controller"},
    "Study": {"of": "from_model"},
    "World": {
        "body": "read('xpos', name)",
        "site": "read('site_xpos', name)",
        "joint": "read('qpos', name)",
        "joint_velocity": "read('qvel', name)",
        "sensor": "read('sensordata', name)",
        "truth": "read('sensordata_ideal', name)",
        "contact_force": "read('body_contact_force', name)",
    },
    "Stepper.randomize": {"mask": "envs"},
    "Stepper": {
        "observation": "sensordata",
        "obs": "sensordata",
        "sensor_truth": "sensordata_ideal",
        "depth": "max_penetration",
        "penetration": "max_penetration",
        "limit_overshoot": "max_limit_violation",
        "sweeps": "iterations",
        "solver_niter": "iterations",
        "solver_fwdinv": "residual",
        "warning": "status",
        "bias_force": "qfrc_bias",
        "smooth_acceleration": "qacc_smooth",
        "qacc_warmstart": "get_state()",
        "qM": "mass_matrix()",
        "M": "mass_matrix()",
        "fullM": "mass_matrix()",
        **dict.fromkeys(("contact", "ncon", "nefc", "efc_force"), "contacts()"),
        "contact_force": "body_contact_force",
        "opt": "options",
        "xmat": "xquat",
        "ximat": "xquat and model.body_iquat, the inertial frame in that of the body",
        "geom_xmat": "geom_xquat",
        "site_xmat": "site_xquat",
        "xanchor": "xpos, xquat and model.joint(name).pos, the anchor in the frame of the body",
        "body_xpos": "xpos",
        "body_xquat": "xquat",
        "xvelp": "body_linvel",
        "xvelr": "body_angvel",
        "qfrc_inverse": "inverse_dynamics(qacc)",
        "inverse": "inverse_dynamics(qacc)",
        "mj_inverse": "inverse_dynamics(qacc)",
        "jac": "jacobian(body=..., site=...)",
        "mj_ray": "rays(points, directions)",
        "ray": "rays(points, directions)",
        "transition_fd": "linearize()",
        "copy": "copy_state(sources, envs)",
        "restore": "set_state(states, envs)",
        "render": "view()",
        "launch_passive": "view()",
        "dt": "timestep",
        **dict.fromkeys(("nworld", "n_envs", "nenv", "num_worlds"), "num_envs"),
        "frame_skip": "step(ctrl, nstep)",
        "mj_step": "step(ctrl)",
        "do_simulation": "step(ctrl, nstep)",
        "set_ctrl": "step(ctrl)",
        "state_vector": "get_state()",
        "reset_model": "reset()",
        "mj_resetData": "reset()",
        "set_envs_state": "set_state(qpos, qvel, envs)",
        "data": "qpos, xpos, sensordata and others of the stepper itself",
        "init_qpos": "model.qpos0",
        "init_qvel": "reset(qvel=...), zero by default",
        **dict.fromkeys(("forward", "mj_forward", "kinematics"), "qacc or another attribute: all follow from the state"),
        "body": "read('xpos', name) for values, or sim.model.body(name)",
        "site": "read('site_xpos', name) for values, or sim.model.site(name)",
        "geom": "read('geom_xpos', name) for values, or sim.model.geom(name)",
        "joint": "read('qpos', name) for values, or sim.model.joint(name)",
        "sensor": "read('sensordata', name) for values, or sim.model.sensor(name)",
        "actuator": "read('actuator_force', name) for values, or sim.model.actuator(name)",
        "get_body_com": "read('xpos', name)",
        "set_parameters": "randomize(...)",
    },
    "Model": {
        "opt": "timestep, gravity and others of the model; stepper.Options has settings of the step",
        "nsensor": "sensor_names, a list",
        "nkey": "keyframe_names, a list",
        "nmocap": "explain()",
        "names": "body_names, joint_names and others",
        "name2id": "body(name).id, likewise joint, geom, site, actuator, sensor",
        "body_name2id": "body(name).id",
        "site_name2id": "site(name).id",
        "id2name": "body_names and others, lists",
        **{f"{kind}_{name}": f"{kind}(name).{name}" for kind, name in (("body", "parentid"), ("geom", "bodyid"), ("geom", "type"))},
        **{f"jnt_{name}": f"joint(name).{name}" for name in ("qposadr", "dofadr", "type")},
        **{f"sensor_{name}": f"sensor(name).{name}" for name in ("adr", "dim", "type")},
        "jnt_limited": "jnt_range, infinite without a limit",
        "actuator_ctrllimited": "actuator_ctrlrange, infinite without a limit",
        "actuator_gain": "actuator_gainprm",
        "actuator_bias": "actuator_biasprm",
        **{f"actuator_{name}": f"actuator(name).{name}" for name in ("gaintype", "biastype", "trntype", "trnid", "actadr")},
        "body_subtreemass": "body_mass, summed over the subtree",
        "copy": "replace(...), a new model: a model does not change",
        "to_xml": "save(path)",
        "compile": "replace(...), a new model: a model does not change",
    },
    "StepperEnv": _ENVIRONMENT,
    "StepperVectorEnv": _ENVIRONMENT,
}
"""Current names of attributes: for each class or module, a table from other names to the names in stepper.

Other names are those of earlier versions, MuJoCo and Gymnasium.
"""
PLACES = {
    "actuators": ("PID", "DCMotor"),
    "derivatives": ("Kink", "Linearization"),
    "lab": (
        *("Chart", "Comparison", "Outcome", "Parameter", "Policy", "Ranking", "Report", "Study", "Tuning"),
        *("chart", "compare", "rank", "report", "sweep", "tune"),
    ),
    "recording": ("Difference", "RecordingError", "Replay"),
    "sensors": ("Combination", "FieldOfView", "HeightField", "RayFan", "SensorSpec", "devices"),
    "sysid": ("Episode", "FitParameter", "Identification", "Tracked", "Tracker", "identify"),
    "viewer": ("Player", "Renderer", "View", "view"),
}
"""Names that users may look for in `stepper` itself although a submodule has them, by submodule."""
ROOT_NAMES = {
    **{name: f"stepper.{place}.{name}" for place, names in PLACES.items() for name in names},
    "Unknown": "stepper.sysid.FitParameter",
    "Reading": "stepper.sensors.SensorSpec",
    "experiments": "stepper.lab",
    "identification": "stepper.sysid",
    "bodies": "attributes of a stepper.Stepper, as sim.cinert",
    "quantities": "attributes and methods of a stepper.Stepper, as sim.qpos, sim.read(...), sim.inverse_dynamics(...), sim.rays(...)",
    "states": "methods of a stepper.Stepper with envs=, as sim.reset(envs=[3, 5]), and sim.copy_state(...)",
    "cpu_levels": "stepper.doctor.cpu_levels()",
    **dict.fromkeys(
        ("MjModel", "from_xml_path", "from_xml_string", "load_model"), "stepper.load(path or text), which gives a stepper.Model"
    ),
    **dict.fromkeys(("MjData", "Simulation", "Simulator", "Sim"), "stepper.Stepper(model, num_envs)"),
    **dict.fromkeys(("mj_step", "mj_step1", "mj_step2"), "sim.step(ctrl) of a stepper.Stepper"),
    **dict.fromkeys(
        ("mj_forward", "mj_kinematics", "mj_comPos"), "attributes of a stepper.Stepper, which follow from its state, as sim.qacc"
    ),
    **dict.fromkeys(("mj_resetData", "mj_resetDataKeyframe"), "sim.reset() of a stepper.Stepper, with keyframe="),
    **dict.fromkeys(("mj_name2id", "mj_id2name", "mjtObj"), "model.body(name).id and model.body_names, likewise joint, geom, site, sensor"),
    "mj_contactForce": "sim.contacts()['force'] of a stepper.Stepper",
    "mj_inverse": "sim.inverse_dynamics(qacc) of a stepper.Stepper",
    **dict.fromkeys(("mj_jac", "mj_jacBody", "mj_jacSite"), "sim.jacobian(body=..., site=...) of a stepper.Stepper"),
    "mj_fullM": "sim.mass_matrix() of a stepper.Stepper",
    "mj_ray": "sim.rays(points, directions) of a stepper.Stepper",
    "mj_objectVelocity": "sim.body_linvel and sim.body_angvel of a stepper.Stepper",
    "mj_integratePos": "model.integrate_pos(q, dv)",
    "mj_differentiatePos": "model.differentiate_pos(q1, q2)",
    "mjd_transitionFD": "sim.linearize() of a stepper.Stepper",
    **dict.fromkeys(("mj_getState", "mj_setState"), "sim.get_state() and sim.set_state(state) of a stepper.Stepper"),
    "mj_copyData": "sim.copy_state(sources, envs) of a stepper.Stepper",
    "mj_saveLastXML": "model.save(path)",
    "MjSpec": "mujoco.MjSpec, whose compiled model stepper.load takes",
    "put_model": "stepper.load(mujoco_model)",
    **dict.fromkeys(("put_data", "make_data"), "stepper.Stepper(model, num_envs)"),
    "launch_passive": "sim.view() of a stepper.Stepper",
    "rollout": "sim.rollout(ctrl) of a stepper.Stepper; stepper.derivatives.rollout has gradients",
    "linearize": "sim.linearize() of a stepper.Stepper",
    **dict.fromkeys(("make", "make_vec"), "gymnasium.make and gymnasium.make_vec after import stepper.envs"),
    **dict.fromkeys(("Env", "StepperEnv"), "stepper.envs.StepperEnv"),
    **dict.fromkeys(("VectorEnv", "StepperVectorEnv"), "stepper.envs.StepperVectorEnv"),
    "Task": "stepper.envs.Task",
    "wrappers": "those of gymnasium.wrappers.vector",
}
"""Replacements for names that are not in the package `stepper` itself: earlier names, and names of MuJoCo and Gymnasium."""


EARLIER_SELECTORS = {
    "mass": "body_mass[{}]", "com": "body_ipos[{}]", "moments": "body_inertia[{}]", "inertia": "body_inertial[{}]",
    "friction": "geom_friction[{}][0]", "torsion": "geom_friction[{}][1]", "rolling": "geom_friction[{}][2]",
    "restitution": "geom_restitution[{}]", "pair_torsion": "pair_friction[{}][1]", "pair_rolling": "pair_friction[{}][2]",
    "stiffness": "jnt_stiffness[{}]", "damping": "dof_damping[{}]", "armature": "dof_armature[{}]",
    "frictionloss": "dof_frictionloss[{}]", "gain": "actuator_gainprm[{}]", "kp": "actuator_kp[{}]", "kv": "actuator_kv[{}]",
    "kd": "actuator_kv[{}]", "delay": "actuator.delay[{}]", "bias": "sensor.bias[{}]", "scale": "sensor.scale[{}]",
    "lag": "sensor.delay[{}]",
}  # fmt: skip
"""Current selectors of parameters, such as "body_mass[{}]", by the name of the parameter in earlier versions.

{} stands for the names of the selected elements.
"""


NEW_KEYWORDS = {
    **dict.fromkeys(("mask", "reset_mask", "env_ids", "env_idx", "env_mask", "indices", "reset_ids"), "envs"),
    **dict.fromkeys(("n_envs", "nworld", "nenv", "batch_size", "num_worlds"), "num_envs"),
    **dict.fromkeys(("dt", "timestep"), "options=stepper.Options(timestep=...)"),
    **dict.fromkeys(("action", "actions", "control", "controls"), "ctrl"),
    **dict.fromkeys(("frame_skip", "n_steps", "num_steps", "n_frames", "decimation"), "nstep"),
    **dict.fromkeys(("position", "positions", "init_qpos"), "qpos"),
    **dict.fromkeys(("velocity", "velocities", "init_qvel"), "qvel"),
    "dtype": "precision", "nthread": "threads", "num_threads": "threads", "key": "keyframe", "fields": "wrt",
    "contact": "options=stepper.Options(contact=...)",
    "observation": "sensordata",
}  # fmt: skip
"""Current keyword arguments, by the keyword in an earlier version, MuJoCo or Gymnasium.

Error messages give the current keyword as a hint, but only for functions that have this keyword.
"""
NEW_KEYWORDS_OF = {
    "Stepper.set_state": {"cold": "keep_warmstart, its opposite: cold=True is keep_warmstart=False"},
    "Stepper.reset": {"options": "qpos, qvel and keyframe"},
    "Stepper.mass_matrix": dict.fromkeys(("env", "envs"), "mass_matrix()[env]: it has all environments"),
    **{f"Stepper.{name}": {"envs": "env, one environment"} for name in ("get_state", "worst_row", "save_problem")},
    "Stepper.contacts": {"env": "envs"},
    "stepper.lab.Study": {"drive": "controller", "policy": "controller=stepper.lab.Policy(...)"},
    "stepper.lab.Parameter": {
        "target": "selector, as 'geom_friction[floor,box][0]'",
        "names": "selector, as 'geom_friction[floor,box]'",
        "column": "selector, as 'geom_friction[*][0]'",
    },
    "stepper.sysid.FitParameter": {
        "kind": "selector, as 'geom_friction[floor,box][0]'",
        "of": "selector, as 'geom_friction[floor,box][0]'",
    },
}
"""Current keyword arguments that apply to one function only: for each function, a table from the earlier keyword to the current one."""
