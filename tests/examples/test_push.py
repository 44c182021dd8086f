"""The box arrives."""

import numpy as np
import push


def test_the_box_comes_to_the_goal():
    plan = push.push(verbose=False)
    # It begins 0.16 m away; examples/README.md says 1 mm.
    assert np.linalg.norm(plan.qpos[-1, :2] - [0.15, 0.06]) < 5e-3
