"""Settings of every test run."""

import mujoco
from hypothesis import HealthCheck, settings

# Examples have no deadline, since a scene must be compiled before a fast step. The profile "stepper" runs the same examples every time, so
# that a failure on one machine is a failure on all. `make properties` runs others every time, and prints how to repeat a failure.
slow = {"deadline": None, "suppress_health_check": [HealthCheck.too_slow]}
settings.register_profile("stepper", max_examples=25, derandomize=True, **slow)
settings.register_profile("properties", max_examples=100, derandomize=False, print_blob=True, **slow)
settings.load_profile("stepper")

# Some robots use attributes that MuJoCo 4 deprecates; its own handler would write that to MUJOCO_LOG.TXT in the working directory.
mujoco.set_mju_user_warning(lambda message: None)
