"""Names of other libraries for methods of a task, and tables of `_guesses.toml` that `stepper.envs` reads."""

from __future__ import annotations

from stepper._hints import replacements


def _by_name(names: dict[str, str]) -> dict[str, str]:
    """Table from names to replacements.

    In `names`, each replacement has the names for which it stands, separated by spaces. NAME in a replacement stands for the name.
    """
    return {name: text.replace("NAME", name) for text, listed in names.items() for name in listed.split()}


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
        "return {'policy': rows, 'critic': Group(rows, noise=False, extra=(...))} in observations(self)": (
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
RENAMED = {"Task": _METHODS_OF_TASKS, "TaskView": replacements("TaskView")}
"""Current names of methods and attributes of tasks: for each class, a table from the name of another library to the current one."""
NEW_NAMES = {kind: replacements("StepperEnv") | replacements(kind) for kind in ("StepperEnv", "StepperVectorEnv")}
"""Replacements for attributes that an environment does not have, by its class, then by name."""
NEW_KEYWORDS = replacements("keywords")
"""Current keyword arguments, by the keyword in another library."""
