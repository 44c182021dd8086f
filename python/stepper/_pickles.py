"""Names under which pickles of earlier versions know the classes of this one."""

import sys

from stepper import actuators, sensors

MODULES = {"stepper._actuators": actuators, "stepper._readings": sensors, "stepper._sensors": sensors}
"""What the module of an earlier version is now."""

sys.modules.update(MODULES)
