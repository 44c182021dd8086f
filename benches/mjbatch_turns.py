"""Process that steps a task over mjbatch, started by benches/environments.py.

mjbatch and stepper's MJCF loader need different versions of MuJoCo, so they cannot share a process. Each line of standard input requests a
measurement turn, and is the processor time of the turn in s. The answer is a line with the times of the turn's steps in s, as a JSON list.
"""

import json
import sys
import time
from typing import Any

import mujoco
import mujoco_vector
import numpy as np
import stepper
from stepper.envs import TASKS
from stepper.envs.assets import model_file


def main() -> None:
    """Step environments for as long as each line of standard input requests, and write the times of the steps.

    Arguments of the command line: name of the task, number of environments, file of the saved stepper model.
    """
    name, num_envs, saved = sys.argv[1], int(sys.argv[2]), sys.argv[3]
    task: Any = TASKS[name]()
    path = model_file(task.xml_file)
    spec = mujoco.MjSpec.from_file(path)
    m = mujoco_vector.with_an_acceleration(spec) if mujoco_vector.reads_contact_forces(task) else spec.compile()
    model = stepper.Model.from_file(saved)
    envs = mujoco_vector.MujocoVectorEnv(
        task, num_envs, engine="mjbatch", m=m, model=model, max_episode_steps=1000, options=stepper.Options()
    )
    space = envs.single_action_space
    actions = np.random.default_rng(0).uniform(space.low, space.high, (50, num_envs, *space.shape))
    envs.reset(seed=0)
    count = 0
    print(json.dumps("ready"), flush=True)
    for line in sys.stdin:
        times: list[float] = []
        end = time.process_time() + float(line)
        while time.process_time() < end or len(times) < 2:
            begin = time.process_time()
            envs.step(actions[count % len(actions)])
            times.append(time.process_time() - begin)
            count += 1
        print(json.dumps(times[1:]), flush=True)  # Without the first step, whose data are not in the CPU caches.


if __name__ == "__main__":
    main()
