"""Visualization: pictures from MuJoCo's renderer, and a view of environments in the browser.

    sim = stepper.Stepper(stepper.load("robot.xml"), 16)
    with stepper.viewer.view(sim) as view:
        view.run()

docs/how-to/view_and_film.md shows more.
"""

from stepper.viewer.live import View, view
from stepper.viewer.looks import LooksError
from stepper.viewer.player import Player
from stepper.viewer.renderer import Renderer

__all__ = ["LooksError", "Player", "Renderer", "View", "view"]
