"""To look at environments: pictures by MuJoCo's renderer, a view in the browser, logs for Rerun."""

from stepper.viewer.looks import LooksError
from stepper.viewer.renderer import Renderer

__all__ = ["LooksError", "Renderer"]
