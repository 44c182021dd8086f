"""Tables from names of earlier versions, MuJoCo, Gymnasium and other simulators to the names in stepper.

`stepper._hints` uses them for hints in error messages.
"""

from __future__ import annotations

_WHOLE_BATCH = "attributes and methods of the whole batch, as envs.unwrapped.sim.qpos and envs.unwrapped.task.<name>"
_PICTURE = "render(), whose pictures have the width, height and camera of gymnasium.make"
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
    **dict.fromkeys(("call", "call_async", "call_wait", "get_attr", "set_attr", "env_method", "env_is_wrapped"), _WHOLE_BATCH),
    "scene": "sim.model",
    **dict.fromkeys(("cfg", "config", "env_cfg"), "task"),
    **dict.fromkeys(("control_timestep", "step_dt", "control_dt"), "dt"),
    **dict.fromkeys(("physics_dt", "sim_dt"), "sim.timestep"),
    **dict.fromkeys(
        ("_get_obs", "get_obs", "_get_observation", "get_observation", "get_observations", "observation", "obs", "obs_buf", "buf_obs"),
        "the observation that reset and step return",
    ),
    **dict.fromkeys(("_get_info", "_get_reset_info", "get_info", "extras", "buf_infos"), "the info dict that reset and step return"),
    **dict.fromkeys(("_get_rew", "rew_buf", "buf_rews"), "the reward that step returns"),
    **dict.fromkeys(
        ("control_cost", "contact_cost", "healthy_cost", "impact_cost", "forward_reward"), "the info dict, which has terms of the reward"
    ),
    "is_healthy": "now.healthy",
    "contact_forces": "stepper.envs.contact_forces(env.unwrapped.now, geoms)",
    **dict.fromkeys(("observation_names", "obs_names", "observation_keys", "observation_layout"), "observation_structure"),
    **dict.fromkeys(("observation_spec", "obs_space"), "observation_space"),
    "action_spec": "action_space",
    "seed": "reset(seed=...)",
    **dict.fromkeys(
        ("_max_episode_steps", "max_episode_steps", "max_episode_length"), "spec.max_episode_steps of gymnasium.make's environment"
    ),
    **dict.fromkeys(
        ("elapsed_steps", "_elapsed_steps", "step_count", "episode_length", "episode_step"), "sim.time / env.unwrapped.dt, rounded"
    ),
    **dict.fromkeys(("width", "height", "viewer", "camera_id", "camera_name", "get_images", "_get_viewer", "viewer_setup"), _PICTURE),
    **dict.fromkeys(("fullpath", "model_path", "xml_path"), "task.xml_file"),
    **dict.fromkeys(("step_mujoco_simulation", "_step_mujoco_simulation", "simulate"), "sim.step(ctrl, nstep)"),
    "device": "arrays of NumPy, or stepper.adapters.torch.TorchVectorEnv for tensors",
    **{name: f"sim.{name}" for name in ("qpos", "qvel", "xpos", "sensordata", "ctrl", "timestep", "status", "randomize", "time")},
}

_METHODS_OF_TASKS = {
    "terminated": (
        *("done", "dones", "is_done", "_is_done", "get_done", "get_dones", "_get_done", "_get_dones", "compute_done", "compute_dones"),
        *("termination", "terminations", "terminate", "terminates", "is_terminated", "is_terminal", "terminal", "get_termination"),
        *("get_terminated", "_get_terminated", "_get_termination", "compute_terminated", "compute_termination", "check_termination"),
        *("should_terminate", "should_terminate_episode", "unhealthy", "is_unhealthy"),
    ),
    "healthy": ("is_healthy", "_is_healthy", "get_healthy", "is_alive", "alive"),
    "truncated": (
        *("truncate", "truncates", "truncation", "truncations", "is_truncated", "get_truncated", "_get_truncated", "compute_truncated"),
        *("check_truncation", "time_out", "timeout", "is_timeout"),
    ),
    "reward": (
        *("rewards", "reward_fn", "reward_function", "get_reward", "get_rewards", "_get_rew", "_get_reward", "_get_rewards", "_reward"),
        *("compute_reward", "compute_rewards", "_compute_reward", "calculate_reward", "calc_reward", "evaluate_reward"),
    ),
    "observations": (
        *("quantities", "obs", "_obs", "observation", "_observation", "_observations", "observe", "get_obs", "_get_obs", "get_observation"),
        *("get_observations", "_get_observation", "_get_observations", "compute_obs", "compute_observation", "compute_observations"),
        *("make_observation", "get_state_observation", "observation_spec", "get_observation_space"),
    ),
    "sample_state": (
        *("start", "reset", "_reset", "reset_model", "reset_idx", "_reset_idx", "reset_state", "reset_states", "reset_task", "reset_env"),
        *("initialize", "initialise", "initialize_episode", "initialise_episode", "initialize_state", "init_state", "initial_state"),
        *("get_initial_state", "sample_initial_state", "sample_init_state", "_get_reset_state", "reset_robot", "reset_root_state"),
    ),
    "on_reset": (
        *("prepare", "randomize", "randomise", "randomization", "randomize_domain", "domain_randomization", "apply_randomization"),
        *("apply_randomizations", "randomize_parameters", "events", "after_reset", "post_reset", "pre_reset", "on_episode_start"),
        *("on_episode_begin", "begin_episode", "start_episode", "resample_commands"),
    ),
    "on_end": ("on_episode_end", "episode_end", "end_episode", "after_episode", "on_done", "finish_episode"),
    "advance": (
        *("step", "_step", "before_step", "after_step", "pre_step", "post_step", "on_step", "before_substep", "after_substep"),
        *("pre_physics_step", "_pre_physics_step", "post_physics_step", "action", "apply_action", "apply_actions", "_apply_action"),
        *("process_action", "process_actions", "set_action", "control", "ctrl", "controller", "simulate", "step_simulation"),
        *("do_simulation", "act", "compute_torques", "_compute_torques"),
    ),
    "action_bounds": ("action_spec", "action_space", "get_action_space", "action_limits", "action_range", "_set_action_space"),
    "sensors": ("sensor", "sensor_model", "sensor_noise", "get_sensors", "noise_model", "make_sensors"),
    "actuators": ("actuator", "actuator_model", "get_actuators", "motor_model", "make_actuators"),
    "model": (
        *("load_model", "get_model", "make_model", "build_model", "create_model", "_load_model", "scene", "create_scene", "setup_scene"),
        *("_setup_scene", "build_scene", "make_scene", "xml", "create_sim", "build"),
    ),
    "info": ("infos", "get_info", "get_infos", "_get_info", "_get_infos", "_get_reset_info", "extras", "metrics"),
    "episode_state": ("memory", "init_buffers", "_init_buffers", "create_buffers", "buffers", "init_episode_state"),
}
"""Names of other libraries, and of earlier versions, for the methods of a task."""
_EPISODE_LIMIT = "give max_episode_steps to the environment or to gymnasium.register instead of {}"
_OF_ENVIRONMENT = "give {} to the environment, as StepperVectorEnv(task, num_envs, {}=...)"
IGNORED_BY_ENVIRONMENTS = {
    "action_space": "define action_bounds(self, model) instead of action_space",
    **{
        name: f"{name} follows from observations(self), remove it"
        for name in ("observation_space", "num_obs", "num_observations", "obs_dim")
    },
    **{
        name: _EPISODE_LIMIT.format(name)
        for name in (
            *("max_episode_steps", "_max_episode_steps", "max_episode_length", "max_steps", "episode_length", "episode_length_s"),
            *("max_episode_length_s", "time_limit", "episode_steps"),
        )
    },
    **{
        name: f"define frame_skip, the number of time steps per action, instead of {name}"
        for name in ("decimation", "control_decimation", "action_repeat", "n_substeps", "nsubsteps", "n_frames", "control_timestep")
    },
    **{name: _OF_ENVIRONMENT.format(name, name) for name in ("options", "precision", "threads", "dtype", "render_mode", "autoreset_mode")},
}
"""Advice on members of a task with names of other libraries, or of arguments of an environment, which environments do not read."""
_BEFORE = "velocity, the rate of change of what Task.position returns, or an array of episode_state that advance(self, now) sets"
RENAMED = {
    "Task": {name: method for method, names in _METHODS_OF_TASKS.items() for name in names},
    "Moment": {
        "memory": "episode_state",
        "rest": "default_qpos",
        **dict.fromkeys(
            ("before", "prev", "previous", "last", "prev_state", "last_state", "previous_state", "last_obs", "prev_obs"), _BEFORE
        ),
        **{f"{when}_{name}": _BEFORE for when in ("prev", "last", "previous", "old") for name in ("qpos", "qvel", "xpos", "position")},
        **dict.fromkeys(
            ("last_action", "last_actions", "prev_action", "prev_actions", "previous_action", "previous_actions"),
            "action, that of the step, or an array of episode_state that advance(self, now) sets, for the action before it",
        ),
        "actions": "action",
        **dict.fromkeys(
            ("obs", "observation", "observations", "obs_buf", "state"), "the quantities of which the observation consists, as now.qpos"
        ),
        **dict.fromkeys(("data", "physics", "mj_data"), "now.qpos, now.xpos, now.sensordata and others"),
        **dict.fromkeys(("env", "envs"), "sim"),
        **dict.fromkeys(
            ("step_count", "steps", "num_steps", "elapsed_steps", "episode_length", "episode_length_buf", "progress_buf", "t"),
            "time, in s since the episode began; now.time / now.dt is the number of actions",
        ),
        **dict.fromkeys(("reward", "rewards", "reward_terms"), "task.reward(now)"),
        **dict.fromkeys(("done", "dones", "is_terminated"), "task.terminated(now)"),
        **dict.fromkeys(("np_random", "random", "generator"), "rng(name)"),
        **dict.fromkeys(("command", "commands", "target", "goal"), "an array of episode_state, which on_reset draws"),
    },
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
    "terrain": (
        *("BoxTerrain", "DiscreteObstacles", "Flat", "Gap", "PyramidSlope", "PyramidStairs", "RandomRough", "SteppingStones"),
        *("SubTerrain", "Terrain", "TerrainCurriculum", "Wave"),
    ),
}
"""Names that users may look for in `stepper.envs` itself, by the submodule of `stepper.envs` that has them."""

STEPS = ("frame_skip", "n_steps", "num_steps", "n_frames", "decimation", "n_sub_steps", "nsubsteps", "substeps")
"""Names of the argument `nstep` in other simulators."""
SELECTIONS = ("mask", "reset_mask", "env_ids", "env_idx", "env_mask", "indices", "reset_ids")
"""Names of the argument `envs` in other simulators."""
_DRIVES = "actuators=stepper.ActuatorModel(...), for drives that stepper.Stepper(model, actuators=...) has"
_READINGS = "stepper.Stepper(model, sensors=stepper.SensorModel(...)): errors of sensors are settings of a stepper"
_RECORDED = (
    *("qpos", "qvel", "act", "ctrl", "sensordata", "readings", "states", "data", "arrays", "trajectory", "load", "read", "times"),
    *("start_state", "to_numpy"),
)
_SEGMENTS = "stepper.recording.segments(path)"
_OWN_TASK = "stepper.envs.Task, whose subclass StepperEnv(task) and StepperVectorEnv(task, num_envs) take"
_METHOD_OF_A_TASK = "a method of stepper.envs.Task, as reward(self, now), terminated(self, now) and on_reset(self, ...)"
_OF_ENVS = {
    **{name: f"stepper.envs.{place}.{name}" for place, names in _TASKS.items() for name in names},
    **{f"{name}Env": f'gymnasium.make("stepper/{name}-v5")' for name in _TASKS["tasks"]},
    "make": 'gymnasium.make("stepper/Hopper-v5")',
    "make_vec": 'gymnasium.make_vec("stepper/Hopper-v5", num_envs=4)',
    "load": 'gymnasium.make("stepper/dm_control.walker-walk-v0"), or stepper.load for a model',
    **dict.fromkeys(
        ("register", "register_env", "register_task"),
        'gymnasium.register("me/Task-v0", entry_point="stepper.envs:StepperEnv", vector_entry_point="stepper.envs:StepperVectorEnv", '
        'kwargs={"task": MyTask})',
    ),
    **dict.fromkeys(
        ("list_envs", "list_tasks", "all_envs", "registry", "ENVS", "ALL_ENVS", "pprint_registry"),
        "stepper.envs.TASKS, or the names in gymnasium.registry that begin with stepper/",
    ),
    **dict.fromkeys(
        ("VecEnv", "VectorEnv", "DummyVecEnv", "SubprocVecEnv", "SyncVectorEnv", "AsyncVectorEnv", "BatchEnv", "BatchedEnv", "EnvPool"),
        "stepper.envs.StepperVectorEnv",
    ),
    **dict.fromkeys(("SB3VecEnv", "StepperVecEnv", "sb3"), "stepper.adapters.sb3.StepperVecEnv"),
    **dict.fromkeys(
        ("Env", "MujocoEnv", "BaseEnv", "GymEnv", "Environment", "ManagerBasedRLEnv", "DirectRLEnv", "VecTask", "PipelineEnv"), _OWN_TASK
    ),
    **dict.fromkeys(("ObservationTerm", "ObsTerm", "ObservationTermCfg", "ObservationSpec", "Obs"), "Observation"),
    **dict.fromkeys(
        ("RewardTerm", "RewTerm", "RewardTermCfg", "TerminationTerm", "TerminationTermCfg", "DoneTerm", "EventTerm", "EventTermCfg"),
        _METHOD_OF_A_TASK,
    ),
    **{name: f"stepper.{name}" for name in ("ActuatorModel", "Drive", "Options", "SensorModel", "Transfer")},
}

NEW_NAMES: dict[str, dict[str, str]] = {
    **RENAMED,
    "stepper.envs": {
        **RENAMED["stepper.envs"],
        **_OF_ENVS,
    },
    "stepper.envs.tasks": {f"{name}Env": f'gymnasium.make("stepper/{name}-v5")' for name in _TASKS["tasks"]},
    "stepper.envs.suite": {
        "load": 'gymnasium.make("stepper/dm_control.walker-walk-v0")',
        **dict.fromkeys(("ALL_TASKS", "BENCHMARKING", "TASKS", "TASKS_BY_DOMAIN", "EASY", "HARD"), "SUITE"),
    },
    "stepper.adapters": {
        **{
            name: f"stepper.adapters.{module}.{name}"
            for module, name in (
                *(("envpool", "StepperPool"), ("native", "make_native"), ("pufferlib", "StepperPufferEnv"), ("ray", "RayVectorEnv")),
                *(("rllib", "register_env"), ("sb3", "StepperVecEnv"), ("torch", "TorchVectorEnv"), ("torchrl", "StepperTorchRLEnv")),
                *(("unisim", "StepperBackend"), ("jax_rollout", "rollout")),
            )
        },
        **dict.fromkeys(("SB3VecEnv", "VecEnv", "stable_baselines3", "DummyVecEnv"), "stepper.adapters.sb3.StepperVecEnv"),
        **dict.fromkeys(("jax", "brax", "mjx"), "stepper.adapters.jax_rollout.rollout"),
        **dict.fromkeys(("gym", "gymnasium"), "gymnasium.make and gymnasium.make_vec after import stepper.envs"),
    },
    "stepper.envs.terrain": {
        **dict.fromkeys(
            (
                "TerrainGenerator",
                "TerrainGeneratorCfg",
                "TerrainImporter",
                "TerrainImporterCfg",
                "TerrainCfg",
                "make",
                "generate",
                "generate_terrain",
                "create",
            ),
            "Terrain",
        ),
        "Curriculum": "TerrainCurriculum",
        **dict.fromkeys(
            (
                "rough",
                "Rough",
                "random_uniform_terrain",
                "RandomUniform",
                "HfRandomUniformTerrainCfg",
                "RandomUniformTerrain",
                "Noise",
                "noise",
                "UniformNoise",
            ),
            "RandomRough",
        ),
        **dict.fromkeys(
            ("stairs", "Stairs", "stairs_terrain", "pyramid_stairs", "pyramid_stairs_terrain", "MeshPyramidStairsTerrainCfg", "Steps"),
            "PyramidStairs",
        ),
        **dict.fromkeys(
            ("InvertedPyramidStairs", "inverted_pyramid_stairs", "MeshInvertedPyramidStairsTerrainCfg"), "PyramidStairs(inverted=True)"
        ),
        **dict.fromkeys(
            ("slope", "Slope", "sloped_terrain", "pyramid_sloped_terrain", "HfPyramidSlopedTerrainCfg", "Ramp"), "PyramidSlope"
        ),
        **dict.fromkeys(("InvertedPyramidSlope", "HfInvertedPyramidSlopedTerrainCfg"), "PyramidSlope(inverted=True)"),
        **dict.fromkeys(("waves", "Waves", "wave_terrain", "HfWaveTerrainCfg", "Hills"), "Wave"),
        **dict.fromkeys(("stepping_stones_terrain", "HfSteppingStonesTerrainCfg", "Stones", "stones"), "SteppingStones"),
        **dict.fromkeys(
            ("discrete_obstacles_terrain", "HfDiscreteObstaclesTerrainCfg", "Obstacles", "obstacles", "Boxes", "boxes"), "DiscreteObstacles"
        ),
        **dict.fromkeys(("gap", "gap_terrain", "MeshGapTerrainCfg", "Gaps"), "Gap"),
        **dict.fromkeys(("flat", "plane", "Plane", "MeshPlaneTerrainCfg", "FlatTerrain"), "Flat"),
        **dict.fromkeys(("Patch", "Tile", "Part", "SubTerrainCfg", "SubTerrainBaseCfg"), "SubTerrain"),
        **dict.fromkeys(
            ("hfield", "HField", "HeightField", "heightfield"),
            "stepper.sensors.HeightField for a model's height field, or Terrain(sub_terrains=...).add_to(spec)",
        ),
    },
    "Reset": {
        **dict.fromkeys(("mask", "env_ids", "env_idx", "ids", "indices"), "envs"),
        "num_envs": "len(reset.envs)",
        "model": "sim.model",
        "memory": "episode_state",
        "data": "sim, with the state in which the last episodes ended",
    },
    "Rng": {
        **dict.fromkeys(("random", "rand", "random_sample", "sample"), "uniform(0, 1, size)"),
        **dict.fromkeys(("standard_normal", "randn", "gauss", "gaussian"), "normal(size)"),
        **dict.fromkeys(("integers", "randint"), "np.floor(rng.uniform(low, high, size)).astype(int)"),
        "choice": "np.asarray(values)[np.floor(rng.uniform(0, len(values), size)).astype(int)]",
        **dict.fromkeys(("binomial", "bernoulli"), "rng.uniform(0, 1, size) < probability"),
        **dict.fromkeys(("permutation", "shuffle"), "rng.uniform(0, 1, size).argsort(axis=1)"),
        "lognormal": "np.exp(mean + std * rng.normal(size))",
        "exponential": "-scale * np.log1p(-rng.uniform(0, 1, size))",
        "seed": "envs.reset(seed=...)",
    },
    "Options": {
        "of": "from_model",
        **dict.fromkeys(("mujoco", "from_mujoco"), "from_model(model)"),
        **dict.fromkeys(("replace", "copy", "_replace"), "dataclasses.replace(options, timestep=...)"),
        **dict.fromkeys(("asdict", "to_dict", "_asdict", "dict"), "dataclasses.asdict(options)"),
    },
    "Recorder": {
        **dict.fromkeys(("record", "capture", "log", "append"), "sim.step(ctrl), which is recorded"),
        **dict.fromkeys(("stop", "stop_recording", "finish", "end", "save", "flush"), "close()"),
        **dict.fromkeys(("start", "start_recording", "open"), "sim.step(ctrl): the recording has started"),
        **dict.fromkeys(_RECORDED, _SEGMENTS),
    },
    "Replay": {**dict.fromkeys(_RECORDED, _SEGMENTS), "sim": "stepper.viewer.Player(path).run(), or the command 'stepper view'"},
    "Segment": {
        **{name: f"readings['{name}']" for name in ("qpos", "qvel", "act", "sensordata")},
        **dict.fromkeys(("dt", "timestep"), "period"),
        "time": "row, period and numpy.arange: call k of step ends k + 1 periods after the start",
        "actions": "ctrl",
    },
    "Linearization": {"a": "A", "b": "B", "c": "C", "d": "D"},
    "Renderer": {
        **dict.fromkeys(("update_scene", "update", "draw"), "render(sim, env)"),
        **dict.fromkeys(
            ("enable_depth_rendering", "disable_depth_rendering"), "sim.rays(points, directions) for distances: pictures are RGB"
        ),
        **dict.fromkeys(
            ("enable_segmentation_rendering", "disable_segmentation_rendering"), "sim.rays(points, directions), which also gives geoms"
        ),
        **dict.fromkeys(("scene", "model", "data"), "render(sim, env), which draws a stepper"),
        **dict.fromkeys(("camera", "cam", "set_camera", "camera_id"), "stepper.viewer.Renderer(model, camera=...)"),
        **dict.fromkeys(("lookat", "distance", "azimuth", "elevation"), "stepper.viewer.Renderer(model, camera_config={'lookat': ...})"),
        **dict.fromkeys(("width", "height"), "stepper.viewer.Renderer(model, width=..., height=...)"),
    },
    "stepper.viewer": {
        **dict.fromkeys(("launch", "launch_passive", "show", "run", "Viewer", "open", "MujocoViewer"), "stepper.viewer.view(sim)"),
        **dict.fromkeys(("render", "OffscreenRenderer"), "stepper.viewer.Renderer(sim.model).render(sim)"),
        **dict.fromkeys(("Camera", "MjvCamera", "MovableCamera"), "stepper.viewer.Renderer(model, camera=...)"),
        **dict.fromkeys(("replay", "play"), "stepper.viewer.Player(path)"),
    },
    "stepper.recording": dict.fromkeys(("load", "read", "open", "Recording", "Reader", "load_recording", "Trajectory"), _SEGMENTS),
    "stepper.sensors": dict.fromkeys(
        ("Noise", "GaussianNoise", "NoiseModel", "SensorNoise", "Sensor"), "SensorModel({'*': Transfer(noise_std=...)})"
    ),
    "stepper.actuators": {
        **dict.fromkeys(("Motor", "Delay", "Actuator"), "ActuatorModel({'*': Drive(delay=...)})"),
        **dict.fromkeys(("PD", "PDController", "Servo", "IdealPDActuator"), "Drive(servo=PID(kp=..., kd=...))"),
    },
    "stepper.derivatives": {
        **dict.fromkeys(("jacobian", "transition_fd"), "sim.linearize()"),
        **dict.fromkeys(("grad", "gradient"), "stepper.derivatives.rollout"),
    },
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
    "Stepper.randomize": {
        **dict.fromkeys(SELECTIONS, "envs"),
        **dict.fromkeys(("delay", "lag"), _DRIVES),
        **dict.fromkeys(("noise", "bias", "scale"), _READINGS),
    },
    "Model.replace": dict.fromkeys(
        ("delay", "noise", "bias", "scale", "lag"), "stepper.Stepper(model, sensors=..., actuators=...), not the model"
    ),
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
        **dict.fromkeys(("fullM", "crb", "full_mass_matrix"), "mass_matrix()"),
        **dict.fromkeys(("contact", "ncon", "get_contacts", "collide", "detect_contacts", "in_contact", "collisions"), "contacts()"),
        **dict.fromkeys(
            ("contact_force", "contact_forces", "net_contact_forces"), "contacts()['force'], or body_contact_force of each body"
        ),
        "opt": "options",
        "xmat": "xquat",
        **dict.fromkeys(("ximat", "xiquat"), "xquat and model.body_iquat, the inertial frame in that of the body"),
        "xaxis": "xquat and model.joint(name).axis, the axis in the frame of the body",
        **{f"body_{field}": f"x{field}, in the world; model.body_{field} is in the frame of the parent" for field in ("pos", "quat")},
        "geom_quat": "geom_xquat, in the world; model.geom_quat is in the frame of the body",
        "geom_pos": "geom_xpos, in the world; sim.randomize(geom_pos=...) sets positions in the frame of the body, then "
        "sim.randomized['geom_pos'] has them; the model has sim.model.geom_pos",
        **{
            f"site_{field}": f"site_x{field}, in the world; model.site(name).{field} is in the frame of the body"
            for field in ("pos", "quat")
        },
        "geom_xmat": "geom_xquat",
        "site_xmat": "site_xquat",
        "xanchor": "xpos, xquat and model.joint(name).pos, the anchor in the frame of the body",
        "body_xpos": "xpos",
        "body_xquat": "xquat",
        **dict.fromkeys(("xvelp", "xvel"), "body_linvel"),
        "xvelr": "body_angvel",
        "qfrc_inverse": "inverse_dynamics(qacc)",
        "inverse": "inverse_dynamics(qacc)",
        "mj_inverse": "inverse_dynamics(qacc)",
        **dict.fromkeys(("mj_ray", "ray", "raycast", "ray_cast", "cast_ray", "raycasts", "multi_ray"), "rays(points, directions)"),
        **dict.fromkeys(("transition_fd", "linearise", "derivatives", "derivative", "grad", "gradient", "gradients", "fd"), "linearize()"),
        "solve_ik": "jacobian(body=name), the Jacobian for inverse kinematics of your own",
        "qfrc_smooth": "sim.mass_matrix() times sim.qacc_smooth",
        "act_dot": "act before and after a step, whose difference divided by sim.timestep is the rate",
        "actuator_moment": "sim.model.actuator_gear, the moment of an actuator of a joint",
        **dict.fromkeys(
            ("ten_J", "ten_J_colind", "ten_J_rowadr", "ten_J_rownnz"), "sim.model.tendon(name).coef of the joints of a fixed tendon"
        ),
        "cdof": "jacobian(body=name)",
        "cdof_dot": "jacobian(body=name), at two times",
        "signature": "sim.model.digest",
        "history": "record(path), which stores all steps",
        **dict.fromkeys(("trajectory", "log", "start_recording", "record_video"), "record(path)"),
        "replay": "stepper.replay(path), with a recording of sim.record(path)",
        **{name: f"model.joint(name).{name}" for name in ("qposadr", "dofadr")},
        "stop_recording": "recorder, which sim.record(path) sets, and its close()",
        **dict.fromkeys(("potential_energy", "kinetic_energy"), "energy()"),
        **dict.fromkeys(("center_of_mass", "center_of_mass_position", "com", "subtree_com_pos"), "subtree_com"),
        **dict.fromkeys(("warnings", "status_names"), "stepper.Status, the flags in sim.status"),
        **dict.fromkeys(("max_contacts", "nconmax"), "stepper.Options(max_contacts=...) in stepper.Stepper(model, options=...)"),
        **dict.fromkeys(("state_size", "nstate"), "get_state().nbytes"),
        "set_seed": "reset(seed=...)",
        **dict.fromkeys(("set_gravity", "opt_gravity"), "randomize(gravity=...)"),
        **dict.fromkeys(("reset_keyframe", "reset_to_keyframe", "mj_resetDataKeyframe"), "reset(keyframe=...)"),
        **dict.fromkeys(("reset_idx", "reset_envs", "reset_done"), "reset(envs=...)"),
        **dict.fromkeys(("torch", "qpos_torch", "device", "jax"), "stepper.adapters.torch, which shares memory of arrays with tensors"),
        **dict.fromkeys(("get_body", "named", "get_body_xpos", "body_position"), "read('xpos', name)"),
        **dict.fromkeys(("get_site", "get_site_xpos"), "read('site_xpos', name)"),
        **dict.fromkeys(("sensor_data", "get_sensor", "sensor_values", "touch", "accelerometer", "gyro"), "read('sensordata', name)"),
        **dict.fromkeys(("bind", "bind_scalar"), "read('xpos', name), the values of one element by its name"),
        **dict.fromkeys(("physics", "env", "unwrapped"), "qpos, xpos, sensordata and others of the stepper itself"),
        **dict.fromkeys(
            ("cam", "camera"),
            ": cameras are not simulated: sim.model has none, and stepper.viewer.Renderer(model, camera=...) draws one of the file",
        ),
        "ten": "model.tendon(name)",
        "tendon": "model.tendon(name)",
        **dict.fromkeys(
            ("models", "model_of", "get_model", "set_model"), "model, one for all environments; sim.randomize(...) sets values of each"
        ),
        **dict.fromkeys(("close", "free", "delete"), ": a stepper needs no closing; a recording by sim.record(path) does"),
        **dict.fromkeys(("viewer", "launch"), "view()"),
        **dict.fromkeys(("copy", "clone", "fork", "duplicate"), "copy.deepcopy(sim) for another stepper, sim.get_state() for its state"),
        **dict.fromkeys(
            ("save", "save_state", "snapshot", "get_states"),
            "get_state(), whose bytes can be stored in a file; sim.model.save(path) stores the model",
        ),
        **dict.fromkeys(("load", "load_state", "restore", "reset_to", "set_states"), "set_state(state), with the state of sim.get_state()"),
        "render": "view()",
        "launch_passive": "view()",
        "dt": "timestep",
        **dict.fromkeys(("nworld", "n_envs", "nenv", "num_worlds", "batch_size", "nbatch"), "num_envs"),
        **dict.fromkeys(("frame_skip", "n_sub_steps", "nsubsteps", "decimation", "do_simulation", "control_timestep"), "step(ctrl, nstep)"),
        **dict.fromkeys(("step1", "step2", "mj_step1", "mj_step2", "mj_step", "substep"), "step(ctrl)"),
        **dict.fromkeys(("advance", "run", "simulate", "integrate", "update", "physics_step", "fetch_results"), "step(ctrl, nstep)"),
        "state_vector": "get_state()",
        "reset_model": "reset()",
        "mj_resetData": "reset()",
        **dict.fromkeys(("timer", "walltime"), ": there are no timers: time.perf_counter() before and after sim.step(ctrl) measures it"),
        "set_envs_state": "set_state(qpos, qvel, envs)",
        "data": "qpos, xpos, sensordata and others of the stepper itself",
        "init_qpos": "model.qpos0",
        "init_qvel": "reset(qvel=...), zero by default",
        **dict.fromkeys(
            ("forward", "mj_forward", "kinematics", "forward_kinematics", "dynamics", "compute", "refresh", "evaluate"),
            "qacc or another attribute: all follow from the state",
        ),
        "body": "read('xpos', name) for values, or sim.model.body(name)",
        "site": "read('site_xpos', name) for values, or sim.model.site(name)",
        "geom": "read('geom_xpos', name) for values, or sim.model.geom(name)",
        "joint": "read('qpos', name) for values, or sim.model.joint(name)",
        "sensor": "read('sensordata', name) for values, or sim.model.sensor(name)",
        "actuator": "read('actuator_force', name) for values, or sim.model.actuator(name)",
        "get_body_com": "read('xpos', name)",
    },
    "State": {
        "save": "bytes, which a file can hold; stepper.State(bytes) reads them",
        **dict.fromkeys(("load", "restore", "apply"), "sim.set_state(state) of a stepper.Stepper"),
        **dict.fromkeys(("copy", "clone"), ": a state does not change, and needs no copy"),
        **dict.fromkeys(("num_envs", "n_envs"), "sim.num_envs of its stepper"),
        **dict.fromkeys(("size", "shape"), "nbytes"),
    },
    "Body": {
        "geoms": "geomadr and geomnum, the range of its geoms",
        "joints": "jntadr and jntnum, the range of its joints",
        "parent": "parentid",
        **dict.fromkeys(("xmat", "ximat"), "sim.read('xquat', name) of a stepper.Stepper"),
        "children": "parentid of the other bodies",
    },
    "Sensor": {"data": "sim.read('sensordata', name) of a stepper.Stepper"},
    "Joint": {"anchor": "pos", "body": "bodyid", **{name: f"model.{name}, at its qposadr" for name in ("qpos0", "qpos_spring")}},
    **{kind: {"body": "bodyid", "xmat": f"sim.read('{kind.lower()}_xquat', name) of a stepper.Stepper"} for kind in ("Geom", "Site")},
    "Actuator": {"joint": "trnid"},
    "Model": {
        "opt": "timestep, gravity and others of the model; stepper.Options has settings of the step",
        **{f"n{kind}": f"len(model.{kind}_names)" for kind in ("sensor", "tendon")},
        "nkey": "len(model.keyframe_names)",
        "neq": "len(model.eq_active0)",
        "nmocap": "sim.mocap_pos.shape[-2], the number of mocap bodies",
        "nactuator": "nu",
        "num_bodies": "nbody",
        **dict.fromkeys(("num_dof", "num_dofs"), "nv"),
        "num_joints": "njnt",
        **{
            name: f"{kind}_names"
            for name, kind in (
                ("bodies", "body"),
                ("joints", "joint"),
                ("geoms", "geom"),
                ("dof_names", "joint"),
                ("jnt_names", "joint"),
                ("sites", "site"),
                ("tendons", "tendon"),
                ("keyframes", "keyframe"),
                ("keys", "keyframe"),
                ("pairs", "pair"),
            )
        },
        **dict.fromkeys(("links", "link_names"), "body_names"),
        "actuators": "actuator_names; sim.actuators has the drives of a stepper.Stepper",
        "total_mass": "model.body_mass.sum()",
        **dict.fromkeys(("jnt", "dof"), "joint(name)"),
        "key": "keyframe(name)",
        "cfrc": "sim.cfrc_ext",
        **dict.fromkeys(
            ("integrator", "cone", "solver", "enableflags", "disableflags"),
            "stepper.Options(integrator=..., iterations=..., tolerance=...) of a stepper.Stepper",
        ),
        **dict.fromkeys(
            ("get_xml", "to_xml_string", "to_xml"), "model.save(path) for the format of stepper; XML is the source file itself"
        ),
        **dict.fromkeys(("from_xml_path", "from_xml_string", "from_binary_path"), "stepper.load(path)"),
        **dict.fromkeys(("ptr", "mjmodel", "mj_model", "mujoco", "to_mujoco"), "mujoco.MjModel.from_xml_path(path) of the same file"),
        **dict.fromkeys(("set", "set_timestep", "set_parameters", "update"), "replace(timestep=...), a new model: a model does not change"),
        **dict.fromkeys(("bind", "bind_scalar"), "body(name), likewise joint, geom, site, actuator, sensor"),
        "body_weldid": "model.body(name).parentid: a body whose jntnum is 0 is fixed to its parent",
        "dof_jntid": "model.joint(name).dofadr and model.joint(name).nv, the degrees of freedom of a joint",
        **{
            name: f"sim.mass_matrix() of a stepper.Stepper after sim.reset(), {text}"
            for name, text in (
                ("dof_M0", "on its diagonal"),
                ("dof_invweight0", "inverted"),
                ("body_invweight0", "with sim.jacobian(body=name)"),
            )
        },
        **{f"jnt_{name}": "jnt_actfrcrange, infinite without a limit" for name in ("actfrclimited",)},
        "actuator_forcelimited": "actuator_forcerange, infinite without a limit",
        "actuator_actlimited": "model.actuator(name).actrange, infinite without a limit",
        **dict.fromkeys(
            ("tendon_num", "tendon_adr", "wrap_objid", "tendon_type", "wrap_type"), "model.tendon(name).jntid, the joints of a fixed tendon"
        ),
        "wrap_prm": "model.tendon(name).coef, the coefficients of the joints of a fixed tendon",
        **dict.fromkeys(("key_mpos", "key_mquat"), "sim.mocap_pos and sim.mocap_quat: a keyframe has no poses of mocap bodies"),
        **dict.fromkeys(
            ("sensor_delay", "sensor_interval", "sensor_history", "sensor_historyadr"),
            "stepper.Transfer(delay=..., period=...) in stepper.Stepper(model, sensors=...)",
        ),
        **dict.fromkeys(
            ("actuator_delay", "actuator_history", "actuator_historyadr", "nhistory"),
            "stepper.Drive(delay=...) in stepper.Stepper(model, actuators=...)",
        ),
        **dict.fromkeys(
            ("body_contype", "body_conaffinity", "body_margin"), "model.geom(name).contype, conaffinity and margin of its geoms"
        ),
        "signature": "digest",
        "names": "body_names, joint_names and others",
        "name2id": "body(name).id, likewise joint, geom, site, actuator, sensor",
        "body_name2id": "body(name).id",
        "site_name2id": "site(name).id",
        "id2name": "body_names and others, lists",
        "jnt_limited": "jnt_range, infinite without a limit",
        "actuator_ctrllimited": "actuator_ctrlrange, infinite without a limit",
        "actuator_gain": "actuator_gainprm",
        "actuator_bias": "actuator_biasprm",
        "body_subtreemass": "body_mass, summed over the subtree by model.body(name).parentid",
        "copy": "replace(...), a new model: a model does not change",
        "compile": "replace(...), a new model: a model does not change",
    },
    "StepperEnv": {
        **_ENVIRONMENT,
        **dict.fromkeys(("num_obs", "num_observations", "obs_dim"), "observation_space.shape"),
        **dict.fromkeys(("num_actions", "action_dim"), "action_space.shape"),
    },
    "StepperVectorEnv": {
        **_ENVIRONMENT,
        **dict.fromkeys(("num_obs", "num_observations", "obs_dim"), "single_observation_space.shape"),
        **dict.fromkeys(("num_actions", "action_dim"), "single_action_space.shape"),
        **dict.fromkeys(
            ("elapsed_steps", "_elapsed_steps", "step_count", "episode_length", "episode_step", "episode_length_buf", "progress_buf"),
            "episode_lengths",
        ),
        **dict.fromkeys(("env_fns", "single_env", "venv"), "sim, one stepper with all environments"),
        **dict.fromkeys(("step_async", "step_wait"), "step(actions)"),
        **dict.fromkeys(("reset_async", "reset_wait"), "reset()"),
        **dict.fromkeys(("reset_idx", "reset_done", "reset_at"), "reset(envs=...)"),
    },
}
"""Current names of attributes: for each class or module, a table from other names to the names in stepper.

Other names are those of earlier versions, MuJoCo and Gymnasium.
"""
KINDS = {
    "body": ("body",),
    "joint": ("jnt", "dof"),
    **{kind: (kind,) for kind in ("geom", "pair", "site", "actuator", "sensor")},
    "tendon": ("tendon", "ten"),
    "keyframe": ("key",),
}
"""Prefixes of MuJoCo's names of arrays, such as "jnt" in "jnt_axis", by the kind of element that a model has, such as "joint"."""


def _sensor(kind: str, element: str) -> str:
    """Text of a hint: a sensor of the type `kind` has the quantity; it is on an element, for example a "body"."""
    new = f"stepper.sensors.SensorSpec(type='{kind}', {element}=name)"
    return f": a sensor has it: model.with_sensors({{'new': {new}}}) adds one, and sim.sensordata has its reading"


_NOT_KEPT = ": a stepper.Model does not keep it: mujoco.MjModel.from_xml_path(path) of the same file has it"
_BY_NAME = "model.body_names, model.joint_names and others, lists of names"
_INTERNAL = ": memory and sparse matrices of MuJoCo have no counterpart: sim.mass_matrix() is dense, and sim.memory() counts bytes"
_OF_ENVIRONMENTS = ": rewards, episodes, observations and spaces are those of stepper.envs.StepperEnv and stepper.envs.StepperVectorEnv"
_RENDERED = ": stepper.viewer.Renderer(model) draws pictures with render(sim), and sim.view() opens a live view"
FAMILIES: dict[str, dict[str, str]] = {
    "Model": {
        r"\w+_user|n?user(_\w+|data)": ": user data is not part of a model: keep it in your program",
        r"(\w+_)?n?plugin(\w*)": ": plugins are not simulated: a Python loop can write controls, sim.xfrc_applied and sim.qfrc_applied",
        r"n?cam(era)?s?(_\w+)?": (
            ": cameras are not part of a model: stepper.viewer.Renderer(model, camera=...) draws one of the file, and a site has a "
            "pose: sim.site_xpos"
        ),
        r"n?lights?(_\w+)?": ": lights are not part of a model: stepper.viewer.Renderer(model) draws with those of the file",
        r"n?(numeric|text|tuple)(data|_\w+)?": (
            ": custom numbers and texts are not part of a model: mujoco.MjModel.from_xml_path(path) has them"
        ),
        r"n?(mat|tex|skin)(_\w+|data|bone\w*|face|texvert|vert)?|material|texture|vis|\w+_(rgba|matid|group|castshadow)|tendon_width": (
            ": colours, materials and other looks are not part of a model: stepper.viewer.Renderer(model) and sim.view() draw those "
            "of the file"
        ),
        r"n?mesh\w*|(geom|site)_dataid": (
            ": vertices of meshes are not readable: mujoco.MjModel.from_xml_path(path) of the same file has them"
        ),
        r"n?hfield\w*|height_?fields?|heights|set_hfield": (
            ": stepper.sensors.HeightField(model, geom).elevation has the heights; other heights need another file"
        ),
        r"n?flex\w*": ": flexible bodies are not simulated",
        r"n?(bvh|oct)\w*|body_bvh\w+|geom_(aabb|rbound)": ": bounding volumes are internal and not readable",
        r"n?names(_map)?|name_\w+adr|n?paths|names": _BY_NAME,
        r"eq|eq_(type|obj\w+|names?)|equality\w*|equalities": (
            "model.eq_active0 and model.eq_data, with a row per equality in the order of the file"
        ),
        r"n?exclude(_\w+)?|pair_signature|(collision|geom)_pairs": (
            ": a model does not list pairs that can collide; model.explain() counts them"
        ),
        r"n?tree(_\w+)?|(body|dof)_treeid|body_rootid|dof_parentid|tendon_tree\w+": "model.body(name).parentid, which leads up the tree",
        r"(jnt|tendon|key|n)_?plastic\w*|\w+_springyield|\w+_(stiffness|damping)poly|plastic|\w+_adhesion|flg_adhesion|geom_fluid|"
        r"\w+_actgravcomp": ": a stepper.Model does not keep it: model.explain() lists what is simulated and what is not",
        r"[BCDM]_\w+|dof_(Madr|simplenum|length)|map[DM]2[DM]|ef[mM]\w+|n([BCDM]|J\w+|ef\w+|emax|buffer|arena|jmax|conmax|wrap|out|"
        r"polygonmax)|ten_J\w*|ngravcomp": _INTERNAL,
        r"flg_\w+|stat|\w+_(sameframe|simple|acc0|length0|invweight0|actuatorid|margin|user)|site_size|tendon_(matid|sol\w+|actfrc\w+)|"
        r"actuator_(actearly|\w+num|armature|crank\w+|\w+adr|ctrlspec|damping|dyn\w+|lengthrange)|"
        r"sensor_(datatype|needstage|obj\w+|ref\w+|intprm)": _NOT_KEPT,
    },
    "Stepper": {
        r"i?efc_\w+|n(efc|e|f|l|A|J|Y)|tendon_efcadr": (
            "contacts() for forces of contacts, sim.qfrc_constraint for those of all constraints"
        ),
        r"\w*island\w*|map_\w+|iacc\w*|ifrc_\w+|nidof": ": islands of bodies in contact are internal; sim.contacts() lists contacts",
        r"\w*(awake|asleep)\w*": ": bodies do not sleep: every step moves all of them",
        "ten(don)?_length": _sensor("tendonpos", "tendon"),
        "ten(don)?_velocity": _sensor("tendonvel", "tendon"),
        r"ten_wrap\w+|wrap_(obj|xpos)": "sim.model.tendon(name).jntid, the joints of a fixed tendon",
        "actuator_length": _sensor("actuatorpos", "actuator"),
        "actuator_velocity": _sensor("actuatorvel", "actuator"),
        "subtree_linvel": _sensor("subtreelinvel", "body"),
        "subtree_angmom": _sensor("subtreeangmom", "body"),
        "cacc": _sensor("framelinacc", "body"),
        "cfrc_int": _sensor("force", "site"),
        "(site|geom)_(xvelp|linvel|vel)": _sensor("framelinvel", r"\1"),
        "(site|geom)_(xvelr|angvel)": _sensor("frameangvel", r"\1"),
        "object_(velocity|acceleration)": "body_linvel and sim.body_angvel",
        "qfrc_(passive|damper|spring|fluid|gravcomp|adhesion)": (
            "sim.qfrc_bias - sim.inverse_dynamics(np.zeros(sim.model.nv)), the sum of passive forces"
        ),
        "q(LD|LDiagInv|LU|H|HDiagInv|Deriv)": ": factors are internal: np.linalg.inv(sim.mass_matrix()) is the inverse",
        r"moment_\w+|maxuse_\w+|parena|pstack|pbase|narena|nbuffer|nstack|threadpool": _INTERNAL,
        "solver(_nnz)?": "iterations, sim.newton_steps and sim.residual",
        r"flg_\w+": "qacc or another attribute: all follow from the state",
        "(get_)?(joint|jnt|dof|q)_?(pos|qpos|positions?)|position|positions": "qpos",
        "(get_)?(joint|jnt|dof|q)_?(vel|qvel|velocity|velocities)|velocity|velocities": "qvel",
        "(get_)?(root|joint|dof)_states?": "qpos and sim.qvel; a free joint has 7 and 6 entries in them",
        "(root|base|body|link|rigid_body|ee)_(pos|position|positions|pose|state_w|states)(_w)?|rb_states": "read('xpos', name), and xquat",
        "(root|base|body|link|lin|rigid_body)_?(lin)?_?vel(ocity|p)?(_[bw])?|body_xvelp": "read('body_linvel', name), in world axes",
        "(root|base|body|link)_ang_?vel(_[bw])?|body_xvelr": "read('body_angvel', name), in world axes",
        "projected_gravity(_b)?|root_quat(_w)?|body_xmat": "read('xquat', name), the orientation",
        "set_((joint|dof)_)?(ctrl|controls?|actions?|targets?|(position|effort|velocity)_targets?)(_tensor)?": "step(ctrl)",
        r"set_((joint|dof|root|body)_)?(q?pos|q?positions?|q?vel|velocit\w+|state\w*|act|time)\w*|write_\w+_to_sim|set_joint_qpos": (
            "set_state(qpos=..., qvel=...)"
        ),
        "control|controls|action": "ctrl, which sim.step(ctrl) sets",
        r"apply\w*force\w*|apply_ft|set_xfrc_applied|set_external_\w+|apply": (
            "xfrc_applied, an array of forces on bodies to write to before a step"
        ),
        r"set_mocap\w*": "mocap_pos and sim.mocap_quat, arrays to write to before a step",
        r"(get_)?(\w+_)?jac(obian)?s?\w*": "jacobian(body=name)",
        "((geom|site|body)_)?distance|geom_distance": "contacts(), whose field distance has those of near geoms",
        "obs_buf|rew_buf|reset_buf|progress_buf|rewards?|dones?|terminated|truncated|infos?|metrics": _OF_ENVIRONMENTS,
        r"episodes?(_\w+)?|max_episode_\w+|(elapsed_)?steps|(num|env)_steps|step_count\w*|\w*step_counter": _OF_ENVIRONMENTS,
        r"(observation|action)_(space|spec|size)s?|spaces|(obs|n_?obs|num_obs)(_dim)?|nobs|get_(obs\w*|reward)": _OF_ENVIRONMENTS,
        "(joint|dof|applied|computed|actuator)?_?(torque|effort|actuation)s?|(joint|dof)_forces?(_tensor)?|tau": (
            "qfrc_actuator, or sim.actuator_force of each actuator"
        ),
        "forces?|wrench(es)?|external_(force|wrench)s?": "xfrc_applied for external forces, sim.contacts()['force'] for contacts",
        r"(joint|dof)_\w+_targets?|u|targets?": "ctrl, which sim.step(ctrl) sets",
        "joint_acc|joint_accelerations?|acc|accels?|accelerations?|qdd|ddq|dof_acc": "qacc",
        "q": "qpos",
        "qd|dq|q_vel": "qvel",
        "x|pos|poses?|transforms?|xforms?|com_pos|positions_w|(root|body|link)_link_(pos|pose)_w": (
            "xpos and sim.xquat, by sim.read('xpos', name)"
        ),
        "xd|vel|linear_velocity|com_vel": "read('body_linvel', name), in world axes",
        "ang|ang_vel|angular_velocity": "read('body_angvel', name), in world axes",
        "quat|rot|rotations?|orientations?|euler|rpy|yaw|heading(_w)?|(root|body|link)_(quat|rot|orientation)(_w)?": "read('xquat', name)",
        r"(soft_)?(joint|dof)?_?(pos_)?limits?": "sim.model.jnt_range",
        "ctrl_?range|action_(range|limits)|effort_limits?": "sim.model.actuator_ctrlrange",
        r"default_(joint_pos|root_state|dof_pos)\w*|init_q(_?pos)?|home": "sim.model.qpos0",
        "default_mass(es)?": "sim.model.body_mass",
        "(joint|dof)_friction": "sim.model.dof_frictionloss",
        r"images?|rgb|pixels|video|frames?|screenshot|\w*render_\w+|contexts|depth_image": _RENDERED,
        "rng|random|generator|seed_all|np_random|random_state": "reset(seed=...), for the errors of sensors: nothing else is random",
        "(physics|step|sim|control)_dt": "timestep",
        r"(num|n)_contacts|contact_(pairs|points|pos)|touching|is_colliding|collision|normals?|impulses?|penetrations": "contacts()",
        "num_env|envs|env_origins|num_instances": "num_envs",
        "find_(bodies|joints|links)": "sim.model.body_names, and sim.model.body(name).id of one",
        "actuator_size|action_(size|dim)|n_?actions?|num_act(ions|uators)": "sim.model.nu",
        "q_size": "sim.model.nq",
        "qd_size": "sim.model.nv",
        "num_links": "sim.model.nbody",
        "activations?": "act",
        r"check_\w+|suppress_\w+|is_valid|errors?": "status, in which an environment without a valid step has a flag of stepper.Status",
        "sys|system|mj_?model|scene|links?": "model",
        "cfg|config|settings": "options",
        r"(refresh|acquire)_\w+": "qacc or another attribute: all follow from the state",
        r"reload_from_\w+|from_byte_string|from_model": "stepper.Stepper(model, num_envs), with the model of stepper.load(path)",
        r"pipeline_step|legacy_step|\w*step_callback": "step(ctrl, nstep)",
        "pipeline_(init|state)|init|initialize": "reset()",
        "(forward|inverse)_kinematics|ik|fk": "xpos and sim.xquat, which follow from sim.qpos, and sim.jacobian(body=name)",
        "(clear|reset)_randomization": ": sim.randomize() without arguments restores the values of the model",
        "friction|set_(geom_)?friction": ": sim.randomize(geom_friction=...) sets friction of each environment",
        "mass|set_(body_)?mass": ": sim.randomize(body_mass=...) sets masses of each environment",
        "damping|set_(dof_|joint_)?damping": ": sim.randomize(dof_damping=...) sets damping of each environment",
        "(set_)?(sensor_)?noise": ": stepper.Stepper(model, sensors=stepper.SensorModel(...)) has errors of sensors",
        r"set|(set_)?param(eter)?s?\w*|randomi[sz]ation|domain_\w+|fields?|write|set_\w+": (
            ": sim.randomize(...) sets parameters of each environment, sim.set_state(...) its state, sim.step(ctrl) its controls"
        ),
        r"get|values|get_field|state|states|get_\w+": "read('xpos', name), or another quantity; sim.get_state() has the complete state",
    },
    "stepper": {
        r"MjModel|load_\w*xml\w*|load_model\w*|loads|mjcf|parse|from_\w*": "stepper.load(path)",
        "MjOption|mj_default(Option|SolRefImp|LROpt)|mjt(Integrator|Cone|Solver|Jacobian)|MjLROpt": (
            "stepper.Options(integrator='euler'), with words as values"
        ),
        "mjt(Warning|Stage)|MjWarningStat|mju_warningText": "stepper.Status, the flags in sim.status",
        "mjt(DisableBit|EnableBit)": "stepper.Options(...) for settings of the step; flags of the file hold",
        "mjt(Geom|Joint|Sensor|Trn|Gain|Bias|Dyn|Eq|Tendon|Wrap|Obj|DataType|Actuator)": "words, as in model.geom(name).type",
        "mjtState|mj_(stateSize|extractState|copyState)": "sim.get_state() of a stepper.Stepper",
        r"Mjs\w+|MjSpec|Spec|spec": "mujoco.MjSpec, then stepper.load(spec.compile())",
        r"Mj[vr]\w+|mj[vr]\w+|Scene|scene|render|Viewer|launch|mjt(Camera|Font\w*|VisFlag|RndFlag|Label|Frame\w*|Mouse|Stereo|CatBit|PertBit|Light\w*|DepthMap)|"
        r"mj_(camlight|printScene|printFormattedScene)": _RENDERED,
        r"[gs]et_mj\w+|mj_resetCallbacks|mj_load\w*Plugin\w*|mjtPluginCapabilityBit": (
            ": there are no callbacks or plugins: a Python loop around sim.step(ctrl) writes controls, sim.xfrc_applied and "
            "sim.qfrc_applied"
        ),
        r"mj(u|d)_\w+": "mujoco.\\g<0>, a function of NumPy arrays",
        r"mj_(energy\w+)": "sim.energy() of a stepper.Stepper",
        "mj_(crb|makeM|factorM|fullM|addM)": "sim.mass_matrix() of a stepper.Stepper",
        "mj_mulM2?": "sim.mass_matrix() @ x of a stepper.Stepper",
        "mj_solveM2?": "np.linalg.solve(sim.mass_matrix(), x)",
        "mj_rne": "sim.qfrc_bias of a stepper.Stepper",
        "mj_rnePostConstraint": "sim.cfrc_ext of a stepper.Stepper, and sensors",
        "mj_subtreeVel|mj_angmomMat": "sim.momentum() of a stepper.Stepper, or sensors of type subtreelinvel and subtreeangmom",
        "mj_objectAcceleration": "a sensor of type framelinacc or frameangacc",
        r"mj_(collision|geomDistance|addContact|maxContact)|MjContact|MjPreContact|mjtConDataField|mjtConstraint\w*": (
            "sim.contacts() of a stepper.Stepper"
        ),
        r"mj_sensor\w+|mj_(readSensor|initSensorHistory)": "sim.sensordata of a stepper.Stepper",
        r"mj_(readCtrl|initCtrlHistory|resetCtrl|actuatorInputName)|mjtCtrl\w+": "sim.ctrl of a stepper.Stepper, which sim.step(ctrl) sets",
        r"mj_(multiRay|ray\w+)|mjtRayDataField": "sim.rays(points, directions) of a stepper.Stepper",
        r"mj_jac\w*|mj_mulJac\w+": "sim.jacobian(body=name) of a stepper.Stepper",
        "mj_applyFT": "sim.xfrc_applied of a stepper.Stepper, an array of forces on bodies to write to before a step",
        r"mj_(print|set|size|get)\w*[mM](odel|ass)|mj_print\w+": (
            "model.explain() and model.body_mass.sum(); model.replace(...) makes a model with other values"
        ),
        r"mj_save\w+|mj_embedAssets": "model.save(path) for the format of stepper; XML is the source file itself",
        "mj_setKeyframe": "sim.get_state() of a stepper.Stepper, which keeps a state; keyframes are those of the file",
        "mj_is(Pyramidal|Dual|Sparse)": "model.requested, the settings of the file",
        "mj_insideSite": "sim.site_xpos and sim.site_xquat of a stepper.Stepper",
        "mj_set(Const|LengthRange|Totalmass)": "model.replace(...), which recomputes dependent values",
        r"mj_reset\w+": "sim.reset() of a stepper.Stepper",
        r"mj_(inv\w+|compareFwdInv)": "sim.inverse_dynamics(qacc) of a stepper.Stepper",
        r"mj_version\w*|mjVERSION\w*": "stepper.__version__",
        "mj_normalizeQuat|mj_local2Global": "mujoco.mju_rotVecQuat and others, functions of NumPy arrays",
        r"mj_\w*([cC]ache\w*|Schema|Texture)": "mujoco.\\g<0> of MuJoCo",
        r"mj_\w+": (
            ": stages of a step are not separate: sim.step(ctrl) makes a step, and attributes such as sim.qacc follow from the state"
        ),
        r"mjt\w+": "words in place of enumerations; mujoco.\\g<0> has those of MuJoCo",
        r"mj[A-Z]\w*": "mujoco.\\g<0>",
        r"Mj\w+": (": stepper has no such structure: model, options and state are stepper.Model, stepper.Options and stepper.Stepper"),
        "FatalError|UnexpectedError|StepperError": "stepper.ModelError for models; other errors are ValueError, TypeError and the like",
        r"mjx|mujoco|Physics|physics|Batch\w*|batch|System|Data|World|worlds|sim|get_data": (
            "stepper.load(path) and stepper.Stepper(model, num_envs)"
        ),
        "suite|dm_control|list_envs|registry|VecEnv|gym|gymnasium|tasks": (
            "gymnasium.make(...) after import stepper.envs; stepper.envs.TASKS lists names"
        ),
        "(add_|generate_)?terrains?|Terrain|rough|ground|TerrainGenerator": (
            "the module stepper.envs.terrain, after import stepper.envs.terrain"
        ),
        r"height_?fields?|hfields?|Height\w*": "stepper.sensors.HeightField(model, geom)",
        r"noise|Noise\w*|SensorNoise|Sensors?|sensor|Delay": "stepper.SensorModel(...) with stepper.Transfer(noise_std=..., delay=...)",
        "Actuators?|Motor|actuator": "stepper.ActuatorModel(...) with stepper.Drive(...)",
        "domain_randomi[sz]ation|randomi[sz]ation|DomainRandomi[sz]ation": "sim.randomize(...) of a stepper.Stepper",
        "Log|log|Recording|load_recording|read_recording|Trajectory|trajectory": "stepper.replay(path) for a recording by sim.record(path)",
        "vmap|jit|pmap|parallel": "stepper.Stepper(model, num_envs), which needs no compilation",
        "grad|gradient|derivative": "stepper.derivatives, with derivatives of steps and rollouts",
        "torch|jax|sb3|rllib|ray": "stepper.adapters, with adapters to libraries of learning",
        "convert|to_mujoco|to_mjcf": "mujoco.MjModel.from_xml_path(path) of the same file",
        "ik|inverse_kinematics": "sim.jacobian(body=name) of a stepper.Stepper",
        "utils|math|quat|rotations?": "scipy.spatial.transform and mujoco.mju_mulQuat, functions of NumPy arrays",
        "testspeed|benchmark|profile": "the command: stepper doctor, and stepper.doctor.diagnose()",
    },
}
"""For each class or module, a table from patterns of names of other simulators to their replacements.

A text that begins with ": " is a sentence; other texts follow "use". Names of instances are `model` and `sim`.
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
    **dict.fromkeys(("Noise", "SensorNoise", "NoiseModel"), "stepper.SensorModel({'*': stepper.Transfer(noise_std=...)})"),
    **dict.fromkeys(("Delay", "ActuatorDelay", "DelayedPDActuator"), "stepper.ActuatorModel({'*': stepper.Drive(delay=...)})"),
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
        ("mj_forward", "mj_kinematics", "mj_comPos", "forward"), "attributes of a stepper.Stepper, which follow from its state, as sim.qacc"
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
    **dict.fromkeys(("load_recording", "read_recording", "Recording"), _SEGMENTS),
    "MjSpec": "mujoco.MjSpec, then stepper.load(spec.compile())",
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
    "gear": "actuator_gear[{}]", "stiffness": "jnt_stiffness[{}]", "damping": "dof_damping[{}]", "armature": "dof_armature[{}]",
    "frictionloss": "dof_frictionloss[{}]", "gain": "actuator_gainprm[{}]", "kp": "actuator_kp[{}]", "kv": "actuator_kv[{}]",
    "kd": "actuator_kv[{}]", "delay": "actuator.delay[{}]", "bias": "sensor.bias[{}]", "scale": "sensor.scale[{}]",
    "lag": "sensor.delay[{}]",
}  # fmt: skip
"""Current selectors of parameters, such as "body_mass[{}]", by the name of the parameter in earlier versions.

{} stands for the names of the selected elements.
"""


NEW_KEYWORDS = {
    **dict.fromkeys(SELECTIONS, "envs"),
    **dict.fromkeys(("n_envs", "nworld", "nenv", "batch_size", "num_worlds", "nbatch"), "num_envs"),
    **dict.fromkeys(("dt", "timestep"), "options=stepper.Options(timestep=...)"),
    **dict.fromkeys(("action", "actions", "control", "controls", "u"), "ctrl"),
    **dict.fromkeys(STEPS, "nstep"),
    **dict.fromkeys(("position", "positions", "init_qpos"), "qpos"),
    **dict.fromkeys(("velocity", "velocities", "init_qvel"), "qvel"),
    "dtype": "precision", "nthread": "threads", "num_threads": "threads", "key": "keyframe", "fields": "wrt",
    **{
        name: f"options=stepper.Options({name}=...)"
        for name in ("contact", "integrator", "solver", "iterations", "tolerance", "stabilization", "max_contacts")
    },
    **dict.fromkeys(("nconmax", "njmax"), "options=stepper.Options(max_contacts=...)"),
    "observation": "sensordata",
}  # fmt: skip
"""Current keyword arguments, by the keyword in an earlier version, MuJoCo or Gymnasium.

Error messages give the current keyword as a hint, but only for functions that have this keyword.
"""
NEW_KEYWORDS_OF = {
    "Stepper.reset": {
        "options": "qpos, qvel and keyframe",
        "env": "envs",
        "state": "sim.set_state(state)",
        **{name: f"sim.set_state({name}=...) after the reset" for name in ("time", "act")},
        "ctrl": "sim.step(ctrl) after the reset",
        "noise": "qpos and qvel, with numbers of a generator of your own",
    },
    "Stepper.mass_matrix": dict.fromkeys(("env", "envs"), "mass_matrix()[env]: it has all environments"),
    "stepper.Options": {
        **dict.fromkeys(("dt", "time_step"), "timestep"),
        "gravity": "model.replace(gravity=...): the model has it",
        **dict.fromkeys(
            ("cone", "impratio", "noslip_iterations", "noslip_tolerance", "solref", "solimp"),
            "contact='mujoco', which takes it from the MJCF file",
        ),
        **dict.fromkeys(("disableflags", "enableflags"), "<option><flag .../></option> in the MJCF file"),
        **dict.fromkeys(("frame_skip", "nstep", "decimation", "substeps", "n_frames"), "sim.step(ctrl, nstep)"),
        **dict.fromkeys(("threads", "precision", "seed", "num_envs"), "stepper.Stepper(model, NAME=...)"),
        **dict.fromkeys(("dtype",), "stepper.Stepper(model, precision=...)"),
        **dict.fromkeys(("max_iterations", "max_iter", "ls_iterations"), "iterations"),
        "tol": "tolerance",
        "max_contact": "max_contacts",
        "nconmax": "max_contacts",
    },
    "Options.from_model": {"timestep": "dataclasses.replace(options, timestep=...) of the result"},
    "stepper.load": {
        **dict.fromkeys(("timestep", "dt"), "stepper.Stepper(model, options=stepper.Options(timestep=...))"),
        **dict.fromkeys(("num_envs", "n_envs", "nworld", "options", "precision", "threads", "seed"), "stepper.Stepper(model, NAME=...)"),
        "assets": "stepper.load(mujoco.MjModel.from_xml_string(xml, assets))",
        "terrain": "a geom of type hfield, mesh or box in the MJCF file",
        **dict.fromkeys(("package_dir", "mesh_dir", "search_paths"), "package_dirs"),
    },
    "stepper.Recorder": {
        **dict.fromkeys(("every", "interval", "stride", "fps"), "sim.step(ctrl, nstep): each call of step is one row"),
        **dict.fromkeys(("envs", "fields", "env"), "no selection: a recording has all environments and fields"),
        **dict.fromkeys(("overwrite", "exist_ok"), "a new folder"),
    },
    "stepper.replay": {
        **dict.fromkeys(("view", "render"), "stepper.viewer.Player(path).run()"),
        **dict.fromkeys(("sim", "envs"), "path alone: the recording has its model and settings"),
    },
    "stepper.viewer.Renderer": {
        **dict.fromkeys(("camera_id", "camera_name", "cam"), "camera"),
        **dict.fromkeys(("lookat", "distance", "azimuth", "elevation"), "camera_config={'NAME': ...}"),
        "depth": "sim.rays(points, directions) for distances: pictures are RGB",
        "segmentation": "sim.rays(points, directions), which also gives geoms: pictures are RGB",
        **dict.fromkeys(("shape", "size", "resolution"), "width and height"),
        "max_geom": "nothing: pictures have up to 10,000 geoms",
    },
    "render": {
        **dict.fromkeys(("camera", "camera_id", "camera_name", "cam"), "stepper.viewer.Renderer(model, camera=...)"),
        **dict.fromkeys(("width", "height"), "stepper.viewer.Renderer(model, NAME=...)"),
        **dict.fromkeys(("envs", "env_id", "index"), "env, one environment"),
        "depth": "sim.rays(points, directions) for distances: pictures are RGB",
    },
    "stepper.SensorModel": {"noise": "stepper.SensorModel({'*': stepper.Transfer(noise_std=...)}), or a sensor's name for '*'"},
    "stepper.Transfer": {
        **dict.fromkeys(("std", "white_noise", "sigma", "noise_scale", "noise_level", "stddev"), "noise_std"),
        **dict.fromkeys(("latency", "lag"), "delay"),
        **dict.fromkeys(("offset", "mean"), "bias"),
        "random_walk": "drift_std",
        "clip": "limits",
        "range": "limits",
        "rate": "period",
        "resolution": "quantum",
    },
    "stepper.Drive": {
        "latency": "delay",
        "time_constant": "lag",
        "tau": "lag",
        "command": "delay, lag and others: all act on the control",
        **dict.fromkeys(("kp", "ki", "kd", "pid"), "servo=stepper.actuators.PID(kp=..., kd=...)"),
        **dict.fromkeys(("stall_torque", "no_load_speed", "gear"), "motor=stepper.actuators.DCMotor(NAME=...)"),
        "noise": "a disturbance added to the controls: a drive has no noise",
    },
    **{f"Stepper.{name}": {"envs": "env, one environment"} for name in ("get_state", "worst_row", "save_problem")},
    "Stepper.contacts": {"env": "envs"},
    "Stepper.set_state": {
        "cold": "keep_warmstart, its opposite: cold=True is keep_warmstart=False",
        "env": "envs",
        **dict.fromkeys(("state", "states"), "the first argument, without a keyword"),
        "ctrl": "sim.step(ctrl), which sets controls",
        **{name: f"sim.{name}, an array to write to" for name in ("mocap_pos", "mocap_quat", "xfrc_applied", "qfrc_applied")},
    },
    "stepper.Stepper": {
        "n": "num_envs",
        **dict.fromkeys(("noise", "sensor_noise"), "sensors=stepper.SensorModel(...)"),
        **dict.fromkeys(("delay", "latency", "lag"), "actuators=stepper.ActuatorModel(...) or sensors=stepper.SensorModel(...)"),
        "gravity": "stepper.Stepper(model.replace(gravity=...)), or sim.randomize(gravity=...)",
        **dict.fromkeys(("cone", "impratio"), "options=stepper.Options.from_model(model), for settings of the file"),
        **dict.fromkeys(STEPS, "sim.step(ctrl, nstep)"),
        "device": "threads: it runs on processors, not on a GPU",
        "render_mode": "sim.view() or stepper.viewer.Renderer(model)",
    },
    "Stepper.step": {
        "n": "nstep",
        "dt": "stepper.Stepper(model, options=stepper.Options(timestep=...))",
        **{
            name: f"sim.{name}, an array to write to before the step"
            for name in ("xfrc_applied", "qfrc_applied", "mocap_pos", "mocap_quat")
        },
        "render": "sim.view()",
    },
    "Stepper.rollout": {
        **dict.fromkeys(
            ("outputs", "quantities", "read", "record", "observe", "names", "sensordata"), "fields, as fields=('qpos', 'sensordata')"
        ),
        **dict.fromkeys(("initial_state", "state", "init", "state0"), "initial"),
        "envs": "sim.step(ctrl, nstep, envs): a rollout is of all environments",
    },
    "Stepper.linearize": {
        **dict.fromkeys(("eps", "epsilon", "h", "delta"), "step"),
        "flg_centered": "centered",
        "envs": "linearize()[env]: it has all environments",
    },
    "Stepper.jacobian": {
        **dict.fromkeys(("geom", "point", "pos"), "site, at this place"),
        **dict.fromkeys(("env", "envs"), "jacobian(body=name)[env]: it has all environments"),
        "joint": "body, of this joint",
    },
    "Stepper.rays": {
        **dict.fromkeys(("pnt", "origin", "origins", "start", "starts"), "points"),
        **dict.fromkeys(("vec", "vecs", "direction"), "directions"),
        "bodyexclude": "exclude",
        "geomgroup": "geoms",
        **dict.fromkeys(("cutoff", "max_distance", "max_range"), "the distances of the result, which are not limited"),
    },
    "Stepper.read": {
        **dict.fromkeys(("body", "site", "geom", "joint", "actuator", "sensor", "names", "element"), "of"),
        **dict.fromkeys(("env", "envs"), "read('xpos', name)[env]: it has all environments"),
    },
    "stepper.envs.terrain.Terrain": {
        **dict.fromkeys(("rows", "n_rows", "levels", "num_levels"), "num_rows"),
        **dict.fromkeys(
            ("cols", "num_cols", "columns", "num_columns", "terrains", "terrain", "kinds", "type", "proportions", "terrain_proportions"),
            'sub_terrains, one column for each, as sub_terrains={"rough": RandomRough(), "stairs": PyramidStairs()}',
        ),
        **dict.fromkeys(("length", "width", "tile_size", "terrain_length", "terrain_width"), "size, the side of a square tile"),
        **dict.fromkeys(("resolution", "cell_size", "spacing"), "horizontal_scale"),
        **dict.fromkeys(("difficulty", "difficulties"), "difficulty_range, as difficulty_range=(0.0, 1.0)"),
        "border": "border_width",
    },
    "stepper.envs.Observation": {
        "name": "func=lambda now: now.read('sensordata', 'acc') for elements by name",
        **dict.fromkeys(
            (
                *("names", "of", "body", "bodies", "joint", "joints", "site", "sites", "geom", "geoms", "sensor", "sensors"),
                *("body_name", "joint_names", "sensor_name", "asset_cfg"),
            ),
            "func=lambda now: now.read('xpos', 'torso') for elements by name",
        ),
        **dict.fromkeys(("scale", "scales", "factor", "gain"), "func=lambda now: 0.5 * now.qvel for scaled values"),
        **dict.fromkeys(("offset", "mean", "normalize"), "func=lambda now: now.qpos - now.default_qpos for shifted values"),
        **dict.fromkeys(("fn", "function", "f", "callable", "compute", "value", "quantity"), "func, a function of now"),
        **dict.fromkeys(("index", "indices", "idx", "slice", "column", "cols", "ids"), "columns, as columns=slice(0, 3)"),
        **dict.fromkeys(("std", "noise_std", "corruption", "noise_scale"), "noise, the half width of uniform noise"),
        **dict.fromkeys(("bounds", "limits", "range", "clip_range", "low", "high"), "clip, as clip=(-1.0, 1.0)"),
        **dict.fromkeys(("delay", "history", "history_length", "lag", "buffer"), "Task.sensors, whose SensorModel delays sensordata"),
    },
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
"""Current keyword arguments that apply to one function only: for each function, a table from another keyword to the current one.

NAME stands for the other keyword.
"""
OF_PARTS = {
    "stepper.SensorModel": ("Transfer", "stepper.SensorModel({'*': stepper.Transfer(FIELD)}), or a sensor's name for '*'", "noise_std"),
    "stepper.ActuatorModel": ("Drive", "stepper.ActuatorModel({'*': stepper.Drive(FIELD)}), or an actuator's name for '*'", "delay"),
}
"""Classes that hold parts by name, where users may give the keywords of a part: class of the parts, hint, and the part's field in it.

FIELD stands for the keyword of the part.
"""
