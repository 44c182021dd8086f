"""Settings of every test run."""

import mujoco
from hypothesis import HealthCheck, settings

# A step is fast but a scene has to be compiled first, so examples have no deadline; the same examples run every time, so that a failure on
# one machine is a failure on all.
settings.register_profile("stepper", max_examples=25, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("stepper")

# Some robots use attributes that MuJoCo 4 deprecates; its own handler would write that to MUJOCO_LOG.TXT in the working directory.
mujoco.set_mju_user_warning(lambda message: None)
