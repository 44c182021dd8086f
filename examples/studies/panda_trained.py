"""A Panda picks a cube by a policy that has learned it: where does it fail, with how many iterations, in which law?

The cube lies anywhere within 4 cm. Every 50 ms the policy sees where it is from the hand, how far the fingers are open, and where the hand
is to go. It moves that place by up to 2 cm, and opens or closes the fingers:

    stepper report examples/studies/panda_trained.py

panda_task.py trains it. The same episodes by a script, which is told where the cube lies, are in panda_scripted.py:

    stepper report examples/studies/panda_scripted.py
    python examples/studies/panda_trained.py    # a table of both, and one picture, out/panda.png or what is named
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import stepper
import stepper.policies

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))

import panda_hand as hand  # type: ignore[import-not-found]  # noqa: E402

POLICY = HERE.parent / "policies/panda_pick.npz"


class Trained:
    """The policy, with what it remembers: the hand's target and the fingers' command."""

    def __init__(self) -> None:
        self.policy = stepper.policies.load(POLICY)

    def begin(self, now: Any) -> None:
        """The target is where the hand is."""
        self._target, self._closed = now.read("sensordata", "hand").copy(), np.zeros(now.num_envs)

    def __call__(self, now: Any) -> Any:
        """Targets of seven joints and two fingers."""
        action = self.policy(hand.seen(now.sensordata, self._target, self._closed))
        self._target, self._closed = hand.moved(self._target, action), (action[:, 3] > 0.0).astype(float)
        return hand.controls(self._target, self._closed)


study = hand.picking("panda_trained", Trained(), hand.HOLD)


def both() -> dict[str, Any]:
    """Sweeps by the policy and by the script."""
    from panda_scripted import study as scripted  # type: ignore[import-not-found]  # noqa: PLC0415

    return {name: stepper.lab.sweep(own, cliffs=False).sweep for name, own in (("policy", study), ("script", scripted))}


def table(sweeps: Any) -> None:
    """Prints how many cubes each picks at each friction."""
    for name, found in sweeps.items():
        for setting in ("stepper", *found.study.settings):
            shares = ", ".join(f"{level.value:g}: {level.successes}" for level in found.levels_of("friction", setting))
            print(f"{name}, {setting}: picked of {found.study.episodes}, by friction: {shares}")


def picture(sweeps: Any, file: str) -> None:
    """A panel each for the policy and the script: shares over friction, with Wilson's intervals."""
    from matplotlib.figure import Figure  # noqa: PLC0415

    figure = Figure(figsize=(9, 3.2), dpi=130, layout="constrained")
    shown = {"stepper": "hard contact", "MuJoCo's law, 20 iterations": "MuJoCo's law", "MuJoCo, 20 iterations": "MuJoCo"}
    panels = figure.subplots(1, len(sweeps), sharey=True)
    for panel, (name, found) in zip(panels, sweeps.items(), strict=True):
        for (setting, label), style in zip(shown.items(), ("o-", "s--", "^:"), strict=True):
            levels = found.levels_of("friction", setting)
            share = np.array([level.share for level in levels])
            ends = np.array([level.interval for level in levels]).T
            panel.errorbar(
                [float(level.value) for level in levels], share, abs(ends - share), fmt=style, label=label, capsize=2, markersize=3.5
            )
        panel.set_title(f"by a {name}", fontsize=10)
        panel.set_xlabel("friction of cube and fingers")
        panel.grid(visible=True, color="#dddddd")
    panels[0].set_ylabel("share of cubes picked")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=len(shown), frameon=False)
    Path(file).parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(file)


if __name__ == "__main__":
    found = both()
    table(found)
    picture(found, sys.argv[1] if len(sys.argv) > 1 else "out/panda.png")
