"""Tables from names of earlier versions, MuJoCo, Gymnasium and other simulators to the names in stepper.

`stepper._hints` uses them for hints in error messages.
"""

from __future__ import annotations


def _by_name(names: dict[str, str]) -> dict[str, str]:
    """Table from names to replacements.

    In `names`, each replacement has the names for which it stands, separated by spaces. NAME in a replacement stands for the name.
    """
    return {name: text.replace("NAME", name) for text, listed in names.items() for name in listed.split()}


def _by_name_in(places: dict[str, dict[str, str]]) -> dict[str, dict[str, str]]:
    """Tables of `_by_name` for several classes, modules or calls, by their names."""
    return {place: _by_name(names) for place, names in places.items()}


_WHOLE_BATCH = "attributes and methods of the whole batch, as envs.unwrapped.sim.qpos and envs.unwrapped.task.<name>"
_PICTURE = "render(), whose pictures have the width, height and camera of gymnasium.make"
_ENVIRONMENT = _by_name(
    {
        "sim, as env.unwrapped.sim.qpos": "data",
        "sim": "physics",
        "sim.model.qpos0": "init_qpos",
        "task.reset, which sets velocities of a new episode": "init_qvel",
        "task.frame_skip": "frame_skip",
        "sim.qpos and sim.qvel": "state_vector",
        "sim.read('xpos', name)": "get_body_com",
        "sim.step(ctrl, nstep)": "do_simulation step_mujoco_simulation _step_mujoco_simulation simulate",
        "render()": "mujoco_renderer",
        "reset()": "reset_model",
        "sim, one stepper with all environments": "envs",
        "sim.contacts()": "contacts",
        _WHOLE_BATCH: "call call_async call_wait get_attr set_attr env_method env_is_wrapped",
        "sim.model": "model scene",
        "task": "cfg config env_cfg",
        "dt": "control_timestep step_dt control_dt",
        "sim.timestep": "physics_dt sim_dt",
        "the observation that reset and step return": (
            "_get_obs get_obs _get_observation get_observation get_observations observation obs obs_buf buf_obs"
        ),
        "the info dict that reset and step return": "_get_info _get_reset_info get_info extras buf_infos",
        "the reward that step returns": "_get_rew rew_buf buf_rews",
        "the info dict, which has terms of the reward": "control_cost contact_cost healthy_cost impact_cost forward_reward",
        "task.terminated(env.unwrapped.now)": "is_healthy",
        "stepper.envs.contact_forces(env.unwrapped.now, geoms)": "contact_forces",
        "observation_structure": "observation_names obs_names observation_keys observation_layout",
        "observation_space": "observation_spec obs_space",
        "action_space": "action_spec",
        "reset(seed=...)": "seed",
        "spec.max_episode_steps of gymnasium.make's environment": "_max_episode_steps max_episode_steps max_episode_length",
        "sim.time / env.unwrapped.dt, rounded": "elapsed_steps _elapsed_steps step_count episode_length episode_step",
        _PICTURE: "width height viewer camera_id camera_name get_images _get_viewer viewer_setup",
        "task.xml_file": "fullpath model_path xml_path",
        "arrays of NumPy, or stepper.adapters.torch.TorchVectorEnv for tensors": "device",
    }
)

_METHODS_OF_TASKS = _by_name(
    {
        "terminated": (
            "done dones is_done _is_done get_done get_dones _get_done _get_dones compute_done compute_dones termination terminations "
            "terminate terminates is_terminated is_terminal terminal get_termination get_terminated _get_terminated _get_termination "
            "compute_terminated compute_termination check_termination should_terminate should_terminate_episode unhealthy is_unhealthy "
            "healthy is_healthy _is_healthy get_healthy is_alive alive"
        ),
        "truncated": (
            "truncate truncates truncation truncations is_truncated get_truncated _get_truncated compute_truncated check_truncation "
            "time_out timeout is_timeout"
        ),
        "reward": (
            "reward_fn reward_function get_reward get_rewards _get_rew _get_reward _get_rewards _reward compute_reward "
            "compute_rewards _compute_reward calculate_reward calc_reward evaluate_reward"
        ),
        "observations": (
            "quantities obs _obs observation _observation _observations observe get_obs _get_obs get_observation get_observations "
            "_get_observation _get_observations compute_obs compute_observation compute_observations make_observation "
            "get_state_observation observation_spec get_observation_space"
        ),
        "reset": (
            "start _reset reset_model reset_idx _reset_idx reset_state reset_states reset_task reset_env initialize initialise "
            "initialize_episode initialise_episode initialize_state init_state initial_state get_initial_state sample_initial_state "
            "sample_init_state _get_reset_state reset_robot reset_root_state "
            "prepare randomize randomise randomization randomize_domain domain_randomization apply_randomization apply_randomizations "
            "randomize_parameters after_reset post_reset pre_reset on_episode_start on_episode_begin begin_episode start_episode "
            "resample_commands"
        ),
        "on_end": "on_episode_end episode_end end_episode after_episode on_done finish_episode",
        "advance": (
            "step _step before_step after_step pre_step post_step on_step before_substep after_substep pre_physics_step "
            "_pre_physics_step post_physics_step action apply_action apply_actions _apply_action process_action process_actions "
            "set_action control ctrl controller simulate step_simulation do_simulation act compute_torques _compute_torques"
        ),
        "action_bounds": "action_spec action_space get_action_space action_limits action_range _set_action_space",
        "sensors": "sensor sensor_model sensor_noise get_sensors noise_model make_sensors",
        "actuators": "actuator actuator_model get_actuators motor_model make_actuators",
        "model": (
            "load_model get_model make_model build_model create_model _load_model scene create_scene setup_scene _setup_scene "
            "build_scene make_scene xml create_sim build"
        ),
        "info": "infos get_info get_infos _get_info _get_infos _get_reset_info extras metrics",
        "episode_state": "memory init_buffers _init_buffers create_buffers buffers init_episode_state",
    }
)
"""Methods of a task, by the name in other libraries and earlier versions."""
IGNORED_BY_ENVIRONMENTS = _by_name(
    {
        "define action_bounds(self, model) instead of action_space": "action_space",
        "NAME follows from observations(self), remove it": "observation_space num_obs num_observations obs_dim",
        "give max_episode_steps to the environment or to gymnasium.register instead of NAME": (
            "max_episode_steps _max_episode_steps max_episode_length max_steps episode_length episode_length_s max_episode_length_s "
            "time_limit episode_steps"
        ),
        "define frame_skip, the number of time steps per action, instead of NAME": (
            "decimation control_decimation action_repeat n_substeps nsubsteps n_frames control_timestep"
        ),
        "give NAME to the environment, as StepperVectorEnv(task, num_envs, NAME=...)": (
            "options precision threads dtype render_mode autoreset_mode"
        ),
    }
)
"""Advice on members of a task with names of other libraries, or of arguments of an environment, which environments do not read."""
PARTS_OF_OTHER_TASKS = _by_name(
    {
        "return rows for a critic in observations(self) too, and let the learner select columns by env.unwrapped.observation_structure": (
            "critic_observations critic_obs privileged_observations privileged_obs get_privileged_observations get_critic_observations "
            "compute_critic_observations get_states states"
        ),
        "define `commands`, a dictionary of stepper.envs.commands": (
            "command command_manager get_commands sample_command sample_commands update_command update_commands"
        ),
        "change levels in on_end(self, now, envs), in an array of episode_state that `carried` names": (
            "curriculum curriculums curricula update_curriculum update_terrain_curriculum update_command_curriculum"
        ),
        "return at_start(selector, uniform(low, high)) in events(self)": "startup on_startup at_startup setup prestartup",
        "return every(seconds, push(body, x=(-1, 1))) in events(self)": "interval push push_robot push_robots",
    }
)
"""Advice on methods and tables of a task that other libraries read and environments do not, by name."""
_BEFORE = "velocity, the rate of change of what Task.position returns, or an array of episode_state that advance(self, now) sets"
RENAMED = {
    "Task": _METHODS_OF_TASKS,
    "Moment": _by_name(
        {
            "episode_state": "memory",
            "default_qpos": "rest",
            _BEFORE: (
                "before prev previous last prev_state last_state previous_state last_obs prev_obs prev_qpos prev_qvel prev_xpos "
                "prev_position last_qpos last_qvel last_xpos last_position previous_qpos previous_qvel previous_xpos previous_position "
                "old_qpos old_qvel old_xpos old_position"
            ),
            "previous_action, that of the step before, or action": "last_action last_actions prev_action prev_actions previous_actions",
            "action": "actions",
            "the quantities of which the observation consists, as now.qpos": "obs observation observations obs_buf state",
            "now.qpos, now.xpos, now.sensordata and others": "data physics mj_data",
            "sim": "env envs",
            "time, in s since the episode began; now.time / now.dt is the number of actions": (
                "step_count num_steps elapsed_steps episode_length episode_length_buf progress_buf t"
            ),
            "task.reward(now)": "reward rewards",
            "task.terminated(now)": "done dones is_terminated",
            "rng(name)": "np_random random generator",
            "command(name)": "commands",
            "an array of episode_state, which reset draws": "target goal",
        }
    ),
    "stepper.envs": {"Quantity": "Observation", "Draws": "Rng"},
}
"""Current names of methods and attributes of tasks: for each class or module, a table from the earlier name to the current one."""


_DRIVES = "actuators=stepper.ActuatorModel(...), for drives that stepper.Stepper(model, actuators=...) has"
_READINGS = "stepper.Stepper(model, sensors=stepper.SensorModel(...)): errors of sensors are settings of a stepper"
_SEGMENTS = "stepper.recording.segments(path)"
_OWN_TASK = "stepper.envs.Task, whose subclass StepperEnv(task) and StepperVectorEnv(task, num_envs) take"
_METHOD_OF_A_TASK = "a method of stepper.envs.Task, as reward(self, now), terminated(self, now) and reset(self, reset)"

NEW_NAMES: dict[str, dict[str, str]] = RENAMED | _by_name_in(
    {
        "stepper.envs": {
            "Observation": "Quantity ObservationTerm ObsTerm ObservationTermCfg ObservationSpec Obs",
            "Rng": "Draws",
            'gymnasium.make("stepper/Hopper-v5")': "make",
            'gymnasium.make_vec("stepper/Hopper-v5", num_envs=4)': "make_vec",
            'gymnasium.make("stepper/dm_control.walker-walk-v0"), or stepper.load for a model': "load",
            'gymnasium.register("me/Task-v0", entry_point="stepper.envs:StepperEnv", '
            'vector_entry_point="stepper.envs:StepperVectorEnv", kwargs={"task": MyTask})': "register register_env register_task",
            "stepper.envs.TASKS, or the names in gymnasium.registry that begin with stepper/": (
                "list_envs list_tasks all_envs registry ENVS ALL_ENVS pprint_registry"
            ),
            "stepper.envs.StepperVectorEnv": "VecEnv VectorEnv DummyVecEnv SubprocVecEnv SyncVectorEnv AsyncVectorEnv BatchEnv EnvPool",
            "stepper.adapters.sb3.StepperVecEnv": "SB3VecEnv sb3",
            _OWN_TASK: "Env MujocoEnv BaseEnv GymEnv Environment ManagerBasedRLEnv DirectRLEnv VecTask PipelineEnv",
            _METHOD_OF_A_TASK: "RewardTerm RewTerm RewardTermCfg TerminationTerm TerminationTermCfg DoneTerm EventTerm EventTermCfg",
        },
        "stepper.envs.suite": {
            'gymnasium.make("stepper/dm_control.walker-walk-v0")': "load",
            "SUITE": "ALL_TASKS BENCHMARKING TASKS TASKS_BY_DOMAIN EASY HARD",
        },
        "stepper.adapters": {
            "stepper.adapters.sb3.StepperVecEnv": "SB3VecEnv VecEnv stable_baselines3 DummyVecEnv",
            "stepper.adapters.jax_rollout.rollout": "jax brax mjx",
            "gymnasium.make and gymnasium.make_vec after import stepper.envs": "gym gymnasium",
        },
        "stepper.envs.terrain": {
            "Terrain": "TerrainGenerator TerrainGeneratorCfg TerrainImporter TerrainCfg make generate generate_terrain create",
            "TerrainCurriculum": "Curriculum",
            "RandomRough": "rough Rough random_uniform_terrain RandomUniform HfRandomUniformTerrainCfg RandomUniformTerrain Noise",
            "PyramidStairs": "stairs Stairs stairs_terrain pyramid_stairs pyramid_stairs_terrain MeshPyramidStairsTerrainCfg Steps",
            "PyramidStairs(inverted=True)": "InvertedPyramidStairs inverted_pyramid_stairs MeshInvertedPyramidStairsTerrainCfg",
            "PyramidSlope": "slope Slope sloped_terrain pyramid_sloped_terrain HfPyramidSlopedTerrainCfg Ramp",
            "PyramidSlope(inverted=True)": "InvertedPyramidSlope HfInvertedPyramidSlopedTerrainCfg",
            "Wave": "waves Waves wave_terrain HfWaveTerrainCfg Hills",
            "SteppingStones": "stepping_stones_terrain HfSteppingStonesTerrainCfg Stones stones",
            "DiscreteObstacles": "discrete_obstacles_terrain HfDiscreteObstaclesTerrainCfg Obstacles obstacles Boxes boxes",
            "Gap": "gap gap_terrain MeshGapTerrainCfg Gaps",
            "Flat": "flat plane Plane MeshPlaneTerrainCfg FlatTerrain",
            "SubTerrain": "Patch Tile Part SubTerrainCfg SubTerrainBaseCfg",
            "stepper.sensors.HeightField for a model's height field, or Terrain(sub_terrains=...).add_to(spec)": (
                "hfield HField HeightField heightfield"
            ),
        },
        "Reset": {
            "envs": "mask env_ids env_idx ids indices",
            "len(reset.envs)": "num_envs",
            "sim.model": "model",
            "episode_state": "memory",
            "sim, with the state in which the last episodes ended": "data",
        },
        "Rng": {
            "uniform(0, 1, size)": "random rand random_sample sample",
            "normal(size)": "standard_normal randn gauss gaussian",
            "np.floor(rng.uniform(low, high, size)).astype(int)": "integers randint",
            "np.asarray(values)[np.floor(rng.uniform(0, len(values), size)).astype(int)]": "choice",
            "rng.uniform(0, 1, size) < probability": "binomial bernoulli",
            "rng.uniform(0, 1, size).argsort(axis=1)": "permutation shuffle",
            "np.exp(mean + std * rng.normal(size))": "lognormal",
            "-scale * np.log1p(-rng.uniform(0, 1, size))": "exponential",
            "envs.reset(seed=...)": "seed",
        },
        "Options": {
            "from_model": "of",
            "from_model(model)": "mujoco from_mujoco",
            "dataclasses.replace(options, timestep=...)": "replace copy _replace",
            "dataclasses.asdict(options)": "asdict to_dict _asdict dict",
        },
        "Recorder": {
            "sim.step(ctrl), which is recorded": "record capture log append",
            "close()": "stop stop_recording finish end save flush",
            "sim.step(ctrl): the recording has started": "start start_recording open",
            _SEGMENTS: "qpos qvel act ctrl sensordata readings states data arrays trajectory load read times start_state to_numpy",
        },
        "Replay": {
            _SEGMENTS: "qpos qvel act ctrl sensordata readings states data arrays trajectory load read times start_state to_numpy",
            "stepper.viewer.Player(path).run(), or the command 'stepper view'": "sim",
        },
        "Segment": {
            "readings['NAME']": "qpos qvel act sensordata",
            "period": "dt timestep",
            "row, period and numpy.arange: call k of step ends k + 1 periods after the start": "time",
            "ctrl": "actions",
        },
        "Linearization": {"A": "a", "B": "b", "C": "c", "D": "d"},
        "Renderer": {
            "render(sim, env)": "update_scene update draw",
            "sim.rays(points, directions) for distances: pictures are RGB": "enable_depth_rendering disable_depth_rendering",
            "sim.rays(points, directions), which also gives geoms": "enable_segmentation_rendering disable_segmentation_rendering",
            "render(sim, env), which draws a stepper": "scene model data",
            "stepper.viewer.Renderer(model, camera=...)": "camera cam set_camera camera_id",
            "stepper.viewer.Renderer(model, camera_config={'lookat': ...})": "lookat distance azimuth elevation",
            "stepper.viewer.Renderer(model, width=..., height=...)": "width height",
        },
        "stepper.viewer": {
            "stepper.viewer.view(sim)": "launch launch_passive show run Viewer open MujocoViewer",
            "stepper.viewer.Renderer(sim.model).render(sim)": "render OffscreenRenderer",
            "stepper.viewer.Renderer(model, camera=...)": "Camera MjvCamera MovableCamera",
            "stepper.viewer.Player(path)": "replay play",
        },
        "stepper.recording": {_SEGMENTS: "load read open Recording Reader load_recording Trajectory"},
        "stepper.sensors": {
            "SensorModel({'*': Transfer(noise_std=...)})": "Noise GaussianNoise NoiseModel SensorNoise Sensor",
        },
        "stepper.actuators": {
            "ActuatorModel({'*': Drive(delay=...)})": "Motor Delay Actuator",
            "Drive(servo=PID(kp=..., kd=...))": "PD PDController Servo IdealPDActuator",
        },
        "stepper.derivatives": {"sim.linearize()": "jacobian transition_fd", "stepper.derivatives.rollout": "grad gradient"},
        "selector": {"controller": "drive"},
        "Study": {"from_model": "of"},
        "World": {
            "read('xpos', name)": "body",
            "read('site_xpos', name)": "site",
            "read('qpos', name)": "joint",
            "read('qvel', name)": "joint_velocity",
            "read('sensordata', name)": "sensor",
            "read('sensordata_ideal', name)": "truth",
            "read('body_contact_force', name)": "contact_force",
        },
        "Stepper.randomize": {
            "envs": "mask reset_mask env_ids env_idx env_mask indices reset_ids",
            _DRIVES: "delay lag",
            _READINGS: "noise bias scale sensor_noise",
        },
        "Model.replace": {"stepper.Stepper(model, sensors=..., actuators=...), not the model": "delay noise bias scale lag"},
        "Stepper": {
            "sensordata": "observation obs",
            "sensordata_ideal": "sensor_truth",
            "max_penetration": "depth penetration",
            "max_limit_violation": "limit_overshoot",
            "iterations": "sweeps solver_niter",
            "residual": "solver_fwdinv",
            "status": "warning",
            "qfrc_bias": "bias_force",
            "qacc_smooth": "smooth_acceleration",
            "get_state()": "qacc_warmstart state_vector",
            "mass_matrix()": "qM M fullM crb full_mass_matrix",
            "contacts()": "contact ncon collide detect_contacts in_contact collisions",
            "contacts()['force'], or body_contact_force of each body": "contact_force contact_forces net_contact_forces",
            "options": "opt",
            "xquat": "xmat body_xquat",
            "xquat and model.body_iquat, the inertial frame in that of the body": "ximat xiquat",
            "xquat and model.joint(name).axis, the axis in the frame of the body": "xaxis",
            "xpos, in the world; model.body_pos is in the frame of the parent": "body_pos",
            "xquat, in the world; model.body_quat is in the frame of the parent": "body_quat",
            "geom_xquat, in the world; model.geom_quat is in the frame of the body": "geom_quat",
            "geom_xpos, in the world; sim.randomize(geom_pos=...) sets positions in the frame of the body, then "
            "sim.randomized['geom_pos'] has them; the model has sim.model.geom_pos": "geom_pos",
            "site_xpos, in the world; model.site(name).pos is in the frame of the body": "site_pos",
            "site_xquat, in the world; model.site(name).quat is in the frame of the body": "site_quat",
            "geom_xquat": "geom_xmat",
            "site_xquat": "site_xmat",
            "xpos, xquat and model.joint(name).pos, the anchor in the frame of the body": "xanchor",
            "xpos": "body_xpos",
            "body_linvel": "xvelp xvel",
            "body_angvel": "xvelr",
            "inverse_dynamics(qacc)": "qfrc_inverse inverse",
            "rays(points, directions)": "ray raycast ray_cast cast_ray",
            "linearize()": "transition_fd linearise derivatives derivative grad gradient gradients fd",
            "jacobian(body=name), the Jacobian for inverse kinematics of your own": "solve_ik",
            "sim.mass_matrix() times sim.qacc_smooth": "qfrc_smooth",
            "act before and after a step, whose difference divided by sim.timestep is the rate": "act_dot",
            "sim.model.actuator_gear, the moment of an actuator of a joint": "actuator_moment",
            "sim.model.tendon(name).coef of the joints of a fixed tendon": "ten_J ten_J_colind ten_J_rowadr ten_J_rownnz",
            "jacobian(body=name)": "cdof",
            "jacobian(body=name), at two times": "cdof_dot",
            "record(path), which stores all steps": "history",
            "record(path)": "trajectory log start_recording record_video",
            "stepper.replay(path), with a recording of sim.record(path)": "replay",
            "model.joint(name).NAME": "qposadr dofadr",
            "recorder, which sim.record(path) sets, and its close()": "stop_recording",
            "energy()": "potential_energy kinetic_energy",
            "subtree_com": "center_of_mass center_of_mass_position com",
            "stepper.Status, the flags in sim.status": "warnings status_names",
            "stepper.Options(max_contacts=...) in stepper.Stepper(model, options=...)": "max_contacts nconmax",
            "get_state().nbytes": "state_size nstate",
            "reset(seed=...)": "set_seed",
            "randomize(gravity=...)": "set_gravity opt_gravity",
            "reset(keyframe=...)": "reset_keyframe reset_to_keyframe",
            "reset(envs=...)": "reset_idx reset_envs",
            "stepper.adapters.torch, which shares memory of arrays with tensors": "torch qpos_torch device jax",
            "read('xpos', name)": "named get_body_xpos get_body_com",
            "read('site_xpos', name)": "get_site_xpos",
            "read('sensordata', name)": "sensor_data sensor_values touch accelerometer gyro",
            "qpos, xpos, sensordata and others of the stepper itself": "physics env unwrapped data",
            ": cameras are not simulated: sim.model has none, and stepper.viewer.Renderer(model, camera=...) draws one of "
            "the file": "cam camera",
            "model.tendon(name)": "ten tendon",
            "model, one for all environments; sim.randomize(...) sets values of each": "models model_of get_model set_model",
            ": a stepper needs no closing; a recording by sim.record(path) does": "close free delete",
            "view()": "viewer launch launch_passive",
            "stepper.viewer.Renderer(sim.model).render(sim) for a picture, or sim.view() for a live view": "render",
            "qpos, xpos and other attributes, or read('xpos', name) for one element": "bind bind_scalar",
            "randomize({'geom_friction[floor][0]': ...}), values per environment": "expand unexpand",
            "copy.deepcopy(sim) for another stepper, sim.get_state() for its state": "copy clone fork duplicate",
            "get_state(), whose bytes a file can hold; sim.model.save(path) stores the model": "save save_state snapshot get_states",
            "set_state(state), with the state of sim.get_state()": "load load_state restore reset_to set_states",
            "timestep": "dt",
            "num_envs": "nworld n_envs num_worlds batch_size nbatch",
            "step(ctrl, nstep)": (
                "frame_skip n_sub_steps nsubsteps decimation do_simulation control_timestep advance run simulate integrate update "
                "physics_step fetch_results"
            ),
            "step(ctrl)": "mj_step mj_step1 mj_step2 step1 step2 substep",
            "reset()": "reset_model",
            ": there are no timers: time.perf_counter() before and after sim.step(ctrl) measures it": "timer walltime",
            "set_state(qpos, qvel, envs)": "set_envs_state",
            "reset(qvel=...), zero by default": "init_qvel",
            "qacc or another attribute: all follow from the state": (
                "forward kinematics forward_kinematics dynamics compute refresh evaluate"
            ),
            "read('xpos', name) for values, or sim.model.body(name)": "body",
            "read('site_xpos', name) for values, or sim.model.site(name)": "site",
            "read('geom_xpos', name) for values, or sim.model.geom(name)": "geom",
            "read('qpos', name) for values, or sim.model.joint(name)": "joint",
            "read('sensordata', name) for values, or sim.model.sensor(name)": "sensor",
            "read('actuator_force', name) for values, or sim.model.actuator(name)": "actuator",
        },
        "State": {
            "bytes, which a file can hold; stepper.State(bytes) reads them": "save",
            "sim.set_state(state) of a stepper.Stepper": "load restore apply",
            ": a state does not change, and needs no copy": "copy clone",
            "sim.num_envs of its stepper": "num_envs n_envs",
            "nbytes": "size shape",
        },
        "Body": {
            "geomadr and geomnum, the range of its geoms": "geoms",
            "jntadr and jntnum, the range of its joints": "joints",
            "parentid": "parent",
            "sim.read('xquat', name) of a stepper.Stepper": "xmat ximat",
            "parentid of the other bodies": "children",
        },
        "Sensor": {"sim.read('sensordata', name) of a stepper.Stepper": "data"},
        "Joint": {
            "pos": "anchor",
            "bodyid": "body",
            "model.qpos0, at its qposadr": "qpos0",
            "model.qpos_spring, at its qposadr": "qpos_spring",
        },
        "Geom": {"bodyid": "body", "sim.read('geom_xquat', name) of a stepper.Stepper": "xmat"},
        "Site": {"bodyid": "body", "sim.read('site_xquat', name) of a stepper.Stepper": "xmat"},
        "Actuator": {"trnid": "joint"},
        "Model": {
            "digest": "signature",
            "timestep, gravity and others of the model; stepper.Options has settings of the step": "opt",
            "len(model.sensor_names)": "nsensor",
            "len(model.tendon_names)": "ntendon",
            "len(model.keyframe_names)": "nkey",
            "len(model.eq_active0)": "neq",
            "sim.mocap_pos.shape[-2], the number of mocap bodies": "nmocap",
            "nu": "nactuator",
            "nbody": "num_bodies",
            "nv": "num_dof num_dofs",
            "njnt": "num_joints",
            "body_names": "bodies links link_names",
            "joint_names": "joints dof_names jnt_names",
            "geom_names": "geoms",
            "site_names": "sites",
            "tendon_names": "tendons",
            "keyframe_names": "keyframes keys",
            "pair_names": "pairs",
            "actuator_names; sim.actuators has the drives of a stepper.Stepper": "actuators",
            "model.body_mass.sum()": "total_mass",
            "joint(name)": "jnt dof",
            "keyframe(name)": "key",
            "sim.cfrc_ext": "cfrc",
            "stepper.Options(integrator=..., iterations=...) of a stepper.Stepper": "integrator cone solver enableflags disableflags",
            "model.save(path) for the format of stepper; XML is the source file itself": "get_xml to_xml_string to_xml",
            "stepper.load(path)": "from_xml_path from_xml_string from_binary_path",
            "mujoco.MjModel.from_xml_path(path) of the same file": "ptr mjmodel mj_model mujoco to_mujoco",
            "replace(timestep=...), a new model: a model does not change": "set set_timestep update",
            "body(name), likewise joint, geom, site, actuator, sensor": "bind bind_scalar",
            "model.body(name).parentid: a body whose jntnum is 0 is fixed to its parent": "body_weldid",
            "model.joint(name).dofadr and model.joint(name).nv, the degrees of freedom of a joint": "dof_jntid",
            "sim.mass_matrix() of a stepper.Stepper after sim.reset(), on its diagonal": "dof_M0",
            "jnt_actfrcrange, infinite without a limit": "jnt_actfrclimited",
            "actuator_forcerange, infinite without a limit": "actuator_forcelimited",
            "model.actuator(name).actrange, infinite without a limit": "actuator_actlimited",
            "model.tendon(name).jntid, the joints of a fixed tendon": "tendon_num tendon_adr wrap_objid tendon_type wrap_type",
            "model.tendon(name).coef, the coefficients of the joints of a fixed tendon": "wrap_prm",
            "sim.mocap_pos and sim.mocap_quat: a keyframe has no poses of mocap bodies": "key_mpos key_mquat",
            "stepper.Transfer(delay=..., period=...) in stepper.Stepper(model, sensors=...)": (
                "sensor_delay sensor_interval sensor_history sensor_historyadr"
            ),
            "stepper.Drive(delay=...) in stepper.Stepper(model, actuators=...)": "actuator_delay actuator_history nhistory",
            "model.geom(name).contype, conaffinity and margin of its geoms": "body_contype body_conaffinity body_margin",
            "body(name).id, likewise joint, geom, site, actuator, sensor": "name2id",
            "body(name).id": "body_name2id",
            "site(name).id": "site_name2id",
            "body_names and others, lists": "id2name",
            "jnt_range, infinite without a limit": "jnt_limited",
            "actuator_ctrlrange, infinite without a limit": "actuator_ctrllimited",
            "actuator_gainprm": "actuator_gain",
            "actuator_biasprm": "actuator_bias",
            "body_mass, summed over the subtree by model.body(name).parentid": "body_subtreemass",
            "replace(...), a new model: a model does not change": "copy compile",
        },
        "StepperEnv": {
            "observation_space.shape": "num_obs num_observations obs_dim",
            "action_space.shape": "num_actions action_dim",
        },
        "StepperVectorEnv": {
            "episode_lengths": "elapsed_steps _elapsed_steps step_count episode_length episode_step episode_length_buf progress_buf",
            "single_observation_space.shape": "num_obs num_observations obs_dim",
            "single_action_space.shape": "num_actions action_dim",
            "sim, one stepper with all environments": "env_fns single_env venv",
            "step(actions)": "step_async step_wait",
            "reset()": "reset_async reset_wait",
            "reset(envs=...)": "reset_idx reset_done reset_at",
        },
    }
)
for _kind in ("StepperEnv", "StepperVectorEnv"):
    NEW_NAMES[_kind] = _ENVIRONMENT | NEW_NAMES[_kind]
"""Replacements for attributes that a class or module does not have, by class or module, then by name.

The names are those of earlier versions of stepper and of other simulators.
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
_ENVIRONMENTS_OF_MUJOCO = (
    "(Ant|HalfCheetah|Hopper|Humanoid|HumanoidStandup|InvertedDoublePendulum|InvertedPendulum|Pusher|Reacher|Swimmer|Walker2d)Env"
)
FAMILIES: dict[str, dict[str, str]] = {
    **{module: {_ENVIRONMENTS_OF_MUJOCO: 'gymnasium.make("stepper/\\1-v5")'} for module in ("stepper.envs", "stepper.envs.tasks")},
    "Model": {
        r"\w+_user|n?user(_\w+|data)": ": user data is not part of a model: keep it in your program",
        r"(\w+_)?n?plugin(\w*)": ": plugins are not simulated: a Python loop can write controls, sim.xfrc_applied and sim.qfrc_applied",
        r"n?cam(era)?s?(_\w+)?": (
            ": cameras are not part of a model: stepper.viewer.Renderer(model, camera=...) draws one of the file, and a site has a "
            "pose: sim.site_xpos"
        ),
        r"n?lights?(_\w+)?": ": lights are not part of a model: stepper.viewer.Renderer(model) draws with those of the file",
        r"n?(numeric|text|tuple)(data|_\w+)?": ": custom numbers and texts are not loaded: mujoco.MjModel.from_xml_path(path) has them",
        r"n?(mat|tex|skin)(_\w+|data|bone\w*|face|texvert|vert)?|material|texture|vis|\w+_(rgba|matid|group|castshadow)|tendon_width": (
            ": colours, materials and other looks are not part of a model: stepper.viewer.Renderer(model) and sim.view() draw those "
            "of the file"
        ),
        r"n?mesh\w*|(geom|site)_dataid": ": vertices of meshes are not readable: mujoco.MjModel.from_xml_path(path) has them",
        r"n?hfield\w*|height_?fields?|heights|set_hfield": (
            ": stepper.sensors.HeightField(model, geom).elevation has the heights; other heights need another file"
        ),
        r"n?flex\w*": ": flexible bodies are not simulated",
        r"n?(bvh|oct)\w*|body_bvh\w+|geom_(aabb|rbound)": ": bounding volumes are internal and not readable",
        r"n?names(_map)?|name_\w+adr|n?paths|names": _BY_NAME,
        r"eq|eq_(type|obj\w+|names?)|equality\w*|equalities": "model.eq_active0 and model.eq_data, with a row per equality",
        r"n?exclude(_\w+)?|pair_signature|(collision|geom)_pairs": ": a model has no list of colliding pairs; model.explain() counts them",
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
        r"i?efc_\w+|n(efc|e|f|l|A|J|Y)|tendon_efcadr": "contacts() for forces of contacts, sim.qfrc_constraint for all constraints",
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
        r"(add|apply|set|exert)_?(\w+_)?(force|torque|wrench|impulse|push)(es|s)?(_\w+)?|apply_ft|set_xfrc_\w+|xfrc|xfrc_(force|torque|wrench)\w*|set_external_\w+|"
        "(apply|push)(_(robot|robots|body|bodies|base))?": (
            "xfrc_applied of bodies and sim.qfrc_applied of joints, arrays of forces to write to before a step"
        ),
        r"((re)?set|load|apply|use|go_?to|move_to|set_to|init|restore|from|to)_?(to_)?key(frame)?s?(_\w+)?": (
            "reset(keyframe=...), the state of a keyframe of the file, or sim.reset(qpos=...) another one"
        ),
        r"(add|new|create|make|save|store|capture)_?key(frame)?s?(_\w+)?": (
            ": keyframes are those of the file: sim.get_state() keeps a state, and sim.set_state(state) sets it"
        ),
        r"set_mocap\w*": "mocap_pos and sim.mocap_quat, arrays to write to before a step",
        r"(get_)?site_?jac\w*|(get_)?jac(obian)?\w*_?site\w*": "jacobian(site=name)",
        r"(get_)?(\w+_)?jac(obian)?s?\w*": "jacobian(body=name), or sim.jacobian(site=name)",
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
        "x|pos|poses?|transforms?|xforms?|com_pos|(root|body|link)_link_(pos|pose)_w": "xpos and sim.xquat, by sim.read('xpos', name)",
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
        "from_zip": "mujoco.from_zip(path), then stepper.load(spec)",
        "to_zip": "mujoco.to_zip, which writes a mujoco.MjSpec",
        r"MjModel|load_\w*xml\w*|load_model\w*|loads|mjcf|parse|from_\w*": "stepper.load(path or text), which gives a stepper.Model",
        "MjOption|mj_default(Option|SolRefImp|LROpt)|mjt(Integrator|Cone|Solver|Jacobian)|MjLROpt": (
            "stepper.Options(integrator='euler'), whose values are strings"
        ),
        "mjt(Warning|Stage)|MjWarningStat|mju_warningText": "stepper.Status, the flags in sim.status",
        "mjt(DisableBit|EnableBit)": "stepper.Options(...) for settings of the step; flags of the file hold",
        "mjt(Geom|Joint|Sensor|Trn|Gain|Bias|Dyn|Eq|Tendon|Wrap|Obj|DataType|Actuator)": "strings, as model.geom(name).type",
        "mjtState|mj_(stateSize|extractState|copyState)": "sim.get_state() of a stepper.Stepper",
        r"Mjs\w+|MjSpec|Spec|spec": "mujoco.MjSpec, then stepper.load(spec)",
        r"Mj[vr]\w+|mj[vr]\w+|Scene|scene|render(ing)?|GLContext|glfw|Viewer|launch|mjt(Camera|Font\w*|VisFlag|RndFlag|Label|Frame\w*|Mouse|Stereo|CatBit|PertBit|Light\w*|DepthMap)|"
        r"mj_(camlight|printScene|printFormattedScene)": _RENDERED,
        r"[gs]et_mj\w+|mj_resetCallbacks|mj_load\w*Plugin\w*|mjtPluginCapabilityBit": (
            ": there are no callbacks or plugins: a Python loop around sim.step(ctrl) writes controls, sim.xfrc_applied and "
            "sim.qfrc_applied"
        ),
        "mju_user_(warning|error)": ": there are no callbacks: errors are exceptions, and sim.status has flags of stepper.Status",
        "mju_threadpool": "stepper.Stepper(model, threads=...)",
        "mjd_inverseFD": ": derivatives of inverse dynamics are not computed; sim.linearize() of a stepper.Stepper has those of a step",
        r"mj(u|d)_\w+": "mujoco.\\g<0>, a function without a model",
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
        r"mj_jac\w*|mj_mulJac\w+": "sim.jacobian(body=..., site=...) of a stepper.Stepper",
        "mj_applyFT": "sim.xfrc_applied of a stepper.Stepper, an array of forces on bodies to write to before a step",
        r"mj_(print\w+|sizeModel|getTotalmass)": "model.explain() and model.body_mass.sum()",
        r"mj_save\w+|mj_embedAssets": "model.save(path) for the format of stepper; XML is the source file itself",
        "mj_setKeyframe": "sim.get_state() of a stepper.Stepper, which keeps a state; keyframes are those of the file",
        "mj_is(Pyramidal|Dual|Sparse)": "model.requested, the settings of the file",
        "mj_insideSite": "sim.site_xpos and sim.site_xquat of a stepper.Stepper",
        "mj_set(Const|LengthRange|Totalmass)": "model.replace(...), which recomputes dependent values",
        r"mj_reset\w+": "sim.reset() of a stepper.Stepper, with keyframe=",
        r"mj_(inv\w+|compareFwdInv)": "sim.inverse_dynamics(qacc) of a stepper.Stepper",
        r"mj_version\w*|mjVERSION\w*": "stepper.__version__",
        "mj_normalizeQuat|mj_local2Global": "mujoco.mju_rotVecQuat and others, functions of NumPy arrays",
        r"mj_\w*([cC]ache\w*|Schema|Texture)": "mujoco.\\g<0> of MuJoCo",
        r"mj_\w+": ": stages of a step are not separate: sim.step(ctrl) makes a step, and attributes as sim.qacc follow from the state",
        r"mjt\w+": ": settings and types are strings, such as 'euler'; mujoco.\\g<0> is MuJoCo's enumeration",
        r"mj[A-Z]\w*|MJTNUM_\w+|HEADERS_DIR|PLUGINS_DIR|PLUGIN_HANDLES": "mujoco.\\g<0>",
        r"Mj\w+": ": stepper has no such structure: model, options and state are stepper.Model, stepper.Options and stepper.Stepper",
        "FatalError|UnexpectedError|StepperError": "stepper.ModelError for models; other errors are ValueError, TypeError and the like",
        r"mjx|mujoco|Physics|physics|Batch\w*|batch|System|Data|World|worlds|sim|get_data": (
            "stepper.load(path), and stepper.Stepper(model) for one environment or stepper.Stepper(model, num_envs) for a batch"
        ),
        "suite|dm_control|list_envs|registry|VecEnv|gym|gymnasium|tasks": "gymnasium.make(...); stepper.envs.TASKS lists names",
        "(add_|generate_)?terrains?|Terrain|rough|ground|TerrainGenerator": "stepper.envs.terrain, after import stepper.envs.terrain",
        r"height_?fields?|hfields?|Height\w*": "stepper.sensors.HeightField(model, geom)",
        r"noise|Noise\w*|SensorNoise|Sensors?|sensor|Delay": "stepper.SensorModel(...) with stepper.Transfer(noise_std=..., delay=...)",
        "Actuators?|Motor|actuator": "stepper.ActuatorModel(...) with stepper.Drive(...)",
        "domain_randomi[sz]ation|randomi[sz]ation|DomainRandomi[sz]ation": "sim.randomize(...) of a stepper.Stepper",
        "[lL]og|[rR]ecording|(load|read)_recording|[tT]rajectory": "stepper.recording.segments(path), or stepper.replay(path)",
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
ROOT_NAMES = _by_name(
    {
        "stepper.sysid.FitParameter": "Unknown",
        "stepper.sensors.SensorSpec": "Reading",
        "stepper.ActuatorModel({'*': stepper.Drive(delay=...)})": "Delay ActuatorDelay DelayedPDActuator",
        "attributes of a stepper.Stepper, as sim.cinert": "bodies",
        "attributes and methods of a stepper.Stepper, as sim.qpos, sim.read(...), sim.inverse_dynamics(...), sim.rays(...)": "quantities",
        "methods of a stepper.Stepper with envs=, as sim.reset(envs=[3, 5]), and sim.copy_state(...)": "states",
        "stepper.doctor.cpu_levels()": "cpu_levels",
        "stepper.Stepper(model) for one environment, stepper.Stepper(model, num_envs) for a batch": (
            "MjData Simulation Simulator Sim put_data make_data"
        ),
        "sim.step(ctrl) of a stepper.Stepper": "mj_step mj_step1 mj_step2",
        "attributes of a stepper.Stepper, which follow from its state, as sim.qacc": "mj_forward mj_kinematics mj_comPos forward",
        "model.body(name).id and model.body_names, likewise joint, geom, site, sensor": "mj_name2id mj_id2name mjtObj",
        "sim.contacts()['force'] of a stepper.Stepper": "mj_contactForce",
        "sim.rays(points, directions) of a stepper.Stepper": "mj_ray",
        "sim.body_linvel and sim.body_angvel of a stepper.Stepper": "mj_objectVelocity",
        "model.integrate_pos(q, dv)": "mj_integratePos",
        "model.differentiate_pos(q1, q2)": "mj_differentiatePos",
        "sim.linearize() of a stepper.Stepper": "mjd_transitionFD linearize",
        "sim.get_state() and sim.set_state(state) of a stepper.Stepper": "mj_getState mj_setState",
        "sim.copy_state(sources, envs) of a stepper.Stepper": "mj_copyData",
        "stepper.load(mujoco_model)": "put_model",
        "sim.view() of a stepper.Stepper": "launch_passive",
        "sim.rollout(ctrl) of a stepper.Stepper; stepper.derivatives.rollout has gradients": "rollout",
        "gymnasium.make and gymnasium.make_vec after import stepper.envs": "make make_vec",
        "stepper.envs.StepperEnv": "Env",
        "stepper.envs.StepperVectorEnv": "VectorEnv",
        "those of gymnasium.wrappers.vector": "wrappers",
    }
)
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


NEW_KEYWORDS = _by_name(
    {
        "envs": "mask reset_mask env_ids env_idx env_mask indices reset_ids",
        "num_envs": "n_envs nworld nenv batch_size num_worlds nbatch",
        "options=stepper.Options(timestep=...)": "dt timestep",
        "ctrl": "action actions control controls u",
        "nstep": "frame_skip n_steps num_steps n_frames decimation n_sub_steps nsubsteps substeps",
        "qpos": "position positions init_qpos",
        "qvel": "velocity velocities init_qvel",
        "precision": "dtype",
        "threads": "nthread num_threads",
        "keyframe": "key",
        "wrt": "fields",
        "options=stepper.Options(NAME=...)": "contact integrator solver iterations tolerance stabilization",
        "options=stepper.Options(max_contacts=...)": "max_contacts nconmax njmax",
        "sensordata": "observation",
    }
)
"""Current keyword arguments, by the keyword in an earlier version, MuJoCo or Gymnasium.

Error messages give the current keyword as a hint, but only for functions that have this keyword.
"""
NEW_KEYWORDS_OF = _by_name_in(
    {
        "Stepper.reset": {
            "qpos, qvel and keyframe": "options",
            "envs": "env",
            "sim.set_state(state)": "state",
            "sim.set_state(NAME=...) after the reset": "time act",
            "sim.step(ctrl) after the reset": "ctrl",
            "qpos and qvel, with numbers of a generator of your own": "noise",
        },
        "Stepper.mass_matrix": {"mass_matrix()[env]: it has all environments": "env envs"},
        "stepper.Options": {
            "timestep": "dt time_step",
            "model.replace(gravity=...): the model has it": "gravity",
            "stepper.Stepper(model, sensors=..., actuators=...)": "noise sensor_noise delay action_delay latency",
            "contact='mujoco', which takes it from the MJCF file": "cone impratio noslip_iterations noslip_tolerance solref solimp",
            "<option><flag .../></option> in the MJCF file": "disableflags enableflags",
            "sim.step(ctrl, nstep)": "frame_skip nstep decimation substeps n_frames",
            "stepper.Stepper(model, NAME=...)": "threads precision seed num_envs",
            "stepper.Stepper(model, precision=...)": "dtype",
            "iterations": "max_iterations max_iter ls_iterations",
            "tolerance": "tol",
            "max_contacts": "max_contact nconmax",
        },
        "Options.from_model": {"dataclasses.replace(options, timestep=...) of the result": "timestep"},
        "stepper.load": {
            "stepper.Stepper(model, options=stepper.Options(timestep=...))": "timestep dt",
            "stepper.Stepper(model, NAME=...)": "num_envs n_envs nworld options precision threads seed",
            "stepper.load(mujoco.MjModel.from_xml_string(xml, assets))": "assets",
            "a geom of type hfield, mesh or box in the MJCF file": "terrain",
            "package_dirs": "package_dir mesh_dir search_paths",
            "floor=True": "ground plane ground_plane add_floor add_ground",
            "free_base=True": "floating floating_base free freejoint free_joint root_joint floating_root",
            "free_base, its opposite": "fixed_base fix_base fix_base_link useFixedBase fixed fix_root_link",
        },
        "stepper.Recorder": {
            "sim.step(ctrl, nstep): each call of step is one row": "every interval stride fps",
            "no selection: a recording has all environments and fields": "envs fields env",
            "a new folder": "overwrite exist_ok",
        },
        "stepper.replay": {
            "stepper.viewer.Player(path).run()": "view render",
            "path alone: the recording has its model and settings": "sim envs",
        },
        "stepper.viewer.Renderer": {
            "camera": "camera_id camera_name cam",
            "camera_config={'NAME': ...}": "lookat distance azimuth elevation",
            "sim.rays(points, directions) for distances: pictures are RGB": "depth",
            "sim.rays(points, directions), which also gives geoms: pictures are RGB": "segmentation",
            "width and height": "shape size resolution",
            "Renderer without it: a picture has up to 10,000 geoms": "max_geom",
        },
        "render": {
            "stepper.viewer.Renderer(model, camera=...)": "camera camera_id camera_name cam",
            "stepper.viewer.Renderer(model, NAME=...)": "width height",
            "env, one environment": "envs env_id index",
            "sim.rays(points, directions) for distances: pictures are RGB": "depth",
        },
        "stepper.SensorModel": {
            "stepper.SensorModel({'*': stepper.Transfer(noise_std=...)}), or a sensor's name for '*'": "noise",
        },
        "stepper.Transfer": {
            "noise_std": "std white_noise sigma noise_scale noise_level stddev",
            "delay": "latency lag",
            "bias": "offset mean",
            "drift_std": "random_walk",
            "limits": "clip range",
            "period": "rate",
            "quantum": "resolution",
        },
        "stepper.Drive": {
            "delay": "latency",
            "lag": "time_constant tau",
            "delay, lag and others: all act on the control": "command",
            "servo=stepper.actuators.PID(kp=..., kd=...)": "kp ki kd pid",
            "motor=stepper.actuators.DCMotor(NAME=...)": "stall_torque no_load_speed gear",
            "a disturbance added to the controls: a drive has no noise": "noise",
        },
        "Stepper.get_state": {"env, one environment": "envs"},
        "Stepper.worst_row": {"env, one environment": "envs"},
        "Stepper.save_problem": {"env, one environment": "envs"},
        "Stepper.contacts": {"envs": "env"},
        "Stepper.set_state": {
            "keep_warmstart, its opposite: cold=True is keep_warmstart=False": "cold",
            "envs": "env",
            "the first argument, without a keyword": "state states",
            "sim.step(ctrl), which sets controls": "ctrl",
            "sim.NAME, an array to write to": "mocap_pos mocap_quat xfrc_applied qfrc_applied",
        },
        "stepper.Stepper": {
            "num_envs": "n",
            "sensors=stepper.SensorModel(...)": "noise sensor_noise",
            "actuators=stepper.ActuatorModel(...) or sensors=stepper.SensorModel(...)": "delay latency lag",
            "stepper.Stepper(model.replace(gravity=...)), or sim.randomize(gravity=...)": "gravity",
            "options=stepper.Options.from_model(model), for settings of the file": "cone impratio",
            "sim.step(ctrl, nstep)": "frame_skip n_steps num_steps n_frames decimation n_sub_steps nsubsteps substeps",
            "threads: it runs on processors, not on a GPU": "device",
            "sim.view() or stepper.viewer.Renderer(model)": "render_mode",
        },
        "Stepper.step": {
            "nstep": "n",
            "stepper.Stepper(model, options=stepper.Options(timestep=...))": "dt",
            "sim.NAME, an array to write to before the step": "xfrc_applied qfrc_applied mocap_pos mocap_quat",
            "sim.view()": "render",
        },
        "Stepper.rollout": {
            "fields, as fields=('qpos', 'sensordata')": "outputs quantities read record observe names sensordata",
            "initial": "initial_state state init state0",
            "sim.step(ctrl, nstep, envs): a rollout is of all environments": "envs",
        },
        "Stepper.linearize": {
            "step": "eps epsilon h delta",
            "centered": "flg_centered",
            "linearize()[env]: it has all environments": "envs",
        },
        "Stepper.jacobian": {
            "site: a site of the file marks the point": "geom point pos",
            "jacobian(body=name)[env]: it has all environments": "env envs",
            "body: the body that the joint moves": "joint",
        },
        "Stepper.rays": {
            "points": "pnt origin origins start starts",
            "directions": "vec vecs direction",
            "exclude": "bodyexclude",
            "geoms": "geomgroup",
            "the distances of the result, which are not limited": "cutoff max_distance max_range",
        },
        "Stepper.read": {
            "of": "body site geom joint actuator sensor names element",
            "read('xpos', name)[env]: it has all environments": "env envs",
        },
        "stepper.envs.terrain.Terrain": {
            "num_rows": "rows n_rows levels num_levels",
            'sub_terrains, one column for each, as sub_terrains={"rough": RandomRough(), "stairs": PyramidStairs()}': (
                "cols num_cols columns num_columns terrains terrain kinds type proportions terrain_proportions"
            ),
            "size, the side of a square tile": "length width tile_size terrain_length terrain_width",
            "horizontal_scale": "resolution cell_size spacing",
            "difficulty_range, as difficulty_range=(0.0, 1.0)": "difficulty difficulties",
            "border_width": "border",
        },
        "stepper.envs.Observation": {
            "func=lambda now: now.read('sensordata', 'acc') for elements by name": "name",
            "func=lambda now: now.read('xpos', 'torso') for elements by name": (
                "names of body bodies joint joints site sites geom geoms sensor sensors body_name joint_names sensor_name asset_cfg"
            ),
            "scale": "scales factor gain",
            "func=lambda now: now.qpos - now.default_qpos for shifted values": "offset mean normalize",
            "func, a function of now": "fn function f callable compute value quantity",
            "columns, as columns=slice(0, 3)": "index indices idx slice column cols ids",
            "noise, the half width of uniform noise": "std noise_std corruption noise_scale",
            "clip, as clip=(-1.0, 1.0)": "bounds limits range clip_range low high",
            "Task.sensors, whose SensorModel delays sensordata": "delay lag",
            "an array of episode_state that advance(self, now) shifts by one value, and func, which returns it": (
                "history history_length history_len stack num_stack frame_stack buffer"
            ),
        },
        "stepper.lab.Study": {"controller": "drive", "controller=stepper.lab.Policy(...)": "policy"},
        "stepper.lab.Parameter": {
            "selector, as 'geom_friction[floor,box][0]'": "target",
            "selector, as 'geom_friction[floor,box]'": "names",
            "selector, as 'geom_friction[*][0]'": "column",
        },
        "stepper.sysid.FitParameter": {"selector, as 'geom_friction[floor,box][0]'": "kind of"},
    }
)
"""Current keyword arguments that apply to one function only: for each function, a table from another keyword to the current one."""
PARTS = {
    "stepper.SensorModel": ("Transfer", "stepper.SensorModel({'*': stepper.Transfer(FIELD)}), or a sensor's name for '*'", "noise_std"),
    "stepper.ActuatorModel": ("Drive", "stepper.ActuatorModel({'*': stepper.Drive(FIELD)}), or an actuator's name for '*'", "delay"),
}
"""Hints for keywords of a part, such as a transfer function, that are given to the model which contains such parts.

For each class of models: the class of its parts, the call to write, and the keyword in that call for an unknown name. FIELD stands for the
keyword.
"""
