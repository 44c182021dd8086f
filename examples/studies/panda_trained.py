"""Picking of a cube by a Panda arm with a learned policy: success for several frictions, solver settings, contact laws and engines.

The cube lies at a random place within ±4 cm. Every 50 ms the policy observes the positions of cube, target and fingers (panda_hand.py). It
moves the target of the hand by up to 2 cm, and opens or closes the fingers:

    stepper report examples/studies/panda_trained.py

panda_task.py trains the policy. panda_scripted.py is the same study with a script, which gets the initial position of the cube:

    stepper report examples/studies/panda_scripted.py
    python examples/studies/panda_trained.py [FILE]   # both: prints a table, writes a figure to FILE [out/panda.png]
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
    """Controller that applies the policy, and stores the hand's target and the closing command."""

    def __init__(self) -> None:
        self.policy = stepper.policies.load(POLICY)

    def begin(self, now: Any) -> None:
        """Set the target to the position of the hand."""
        self._target, self._closed = now.read("sensordata", "hand").copy(), np.zeros(now.num_envs)

    def __call__(self, now: Any) -> Any:
        """Servo targets by the policy for n environments, (n, 9): angles of seven joints (rad) and positions of two fingers (m)."""
        action = self.policy(hand.seen(now.sensordata, self._target, self._closed))
        self._target, self._closed = hand.moved(self._target, action), (action[:, 3] > 0.0).astype(float)
        return hand.controls(self._target, self._closed)


study = hand.picking("panda_trained", Trained(), hand.HOLD)


def both() -> dict[str, Any]:
    """Results of the study over all its parameters (`stepper.lab.sweep`) with the "policy" and with the "script", by name."""
    from panda_scripted import study as scripted  # type: ignore[import-not-found]  # noqa: PLC0415

    return {name: stepper.lab.sweep(own, cliffs=False).sweep for name, own in (("policy", study), ("script", scripted))}


def table(sweeps: Any) -> None:
    """Print how many cubes the policy and the script pick at each friction."""
    for name, found in sweeps.items():
        for setting in ("stepper", *found.study.settings):
            shares = ", ".join(f"{level.value:g}: {level.successes}" for level in found.levels_of("friction", setting))
            print(f"{name}, {setting}: cubes picked of {found.study.episodes}, by friction: {shares}")


def picture(sweeps: Any, file: str) -> None:
    """Plot the fraction of picked cubes over friction with Wilson intervals, in one panel each for the policy and the script."""
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
