"""stepper: a rigid-body contact stepper for robots.

    import stepper

    model = stepper.load("humanoid.xml")
    sim = stepper.Stepper(model, num_envs=1024)
    sim.step(ctrl)
    sim.qpos, sim.qvel, sim.residual, sim.status
"""

from stepper._load import load
from stepper._options import Options
from stepper._status import Status
from stepper._stepper import Model, ModelError, State, Stepper, __version__, cpu_levels

__all__ = ["Model", "ModelError", "Options", "State", "Status", "Stepper", "__version__", "cpu_levels", "load"]
