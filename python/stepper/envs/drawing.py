"""What environments say to those who want to see them."""

from __future__ import annotations


def check_render_mode(render_mode: str | None) -> None:
    """Raises ValueError for any mode but None."""
    if render_mode is not None:
        raise ValueError(
            f"render_mode is {render_mode!r}, must be None: these environments draw nothing. "
            "To see them, give env.unwrapped.sim.qpos to mujoco.Renderer"
        )
