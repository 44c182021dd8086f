"""Why a Panda drops cubes at a friction of 0.46 under MuJoCo's law in stepper, and none in MuJoCo: points of contact of boxes.

The episodes of panda_cones.py in MuJoCo, solved to 1e-12: with its own points of contact, and with those of them alone that stepper has in
the same state.

    python examples/studies/panda_points.py
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import stepper
from stepper.experiments.study.worlds import MujocoWorld, Plan

sys.path.insert(0, str(Path(__file__).resolve().parent))

import panda_cones as cones  # type: ignore[import-not-found]
import panda_hand as hand  # type: ignore[import-not-found]
from panda_trained import Trained  # type: ignore[import-not-found]

FRICTION, EPISODES = 0.46, cones.study.episodes
LAW = stepper.Options(contact="mujoco")
RULES: dict[str, Callable[[int, int], bool]] = {
    "MuJoCo's own points": lambda _own, _theirs: False,
    "stepper's points": lambda own, theirs: own < theirs,
    "stepper's, where it has one and MuJoCo two to four": lambda own, theirs: own == 1 < theirs <= 4,
    "stepper's, where MuJoCo has five and more": lambda own, theirs: own < theirs > 4,
}
"""Whether points that stepper lacks are left out of MuJoCo's, of how many points of a pair of geoms in stepper and in MuJoCo."""


class Thinned(MujocoWorld):
    """MuJoCo without the points of contact of a pair that stepper does not have in the same state."""

    def __init__(self, plan: Plan, num_envs: int, rule: Callable[[int, int], bool]):
        super().__init__(plan, num_envs)
        self._rule, self._sim = rule, stepper.Stepper(plan.model, 1, options=LAW)

    def step(self, ctrl: Any, nstep: int) -> None:
        """As mj_step, with contacts left out between its two halves."""
        for model, data, row in zip(self._models, self._data, ctrl, strict=True):
            data.ctrl[:] = row
            for _ in range(nstep):
                mujoco.mj_step1(model, data)
                if self._thin(data):
                    for renew in (mujoco.mj_makeConstraint, mujoco.mj_island, mujoco.mj_projectConstraint, mujoco.mj_referenceConstraint):
                        renew(model, data)
                mujoco.mj_step2(model, data)
        self.time += nstep * self.timestep
        self._fresh = False

    def _thin(self, data: Any) -> bool:
        """Marks what MuJoCo leaves out of its constraints; whether there is any."""
        cube = self.model.geom("cube").id
        theirs: dict[tuple[int, ...], list[int]] = {}
        for i, contact in enumerate(data.contact):
            if cube in contact.geom:
                theirs.setdefault(tuple(sorted(contact.geom)), []).append(i)
        if not theirs:
            return False
        self._sim.set_state(data.qpos[None], data.qvel[None])
        self._sim.step(data.ctrl[None])
        own = self._sim.contacts(env=0)
        marked = False
        for pair, points in theirs.items():
            mine = own[(np.sort(own["geom"], axis=1) == pair).all(axis=1)]
            if not len(mine) or not self._rule(len(mine), len(points)):
                continue
            where, depth = data.contact.pos[points], data.contact.dist[points]
            kept = {points[np.argmin(np.abs(where - p["pos"]).max(axis=1) + abs(depth - p["distance"]))] for p in mine}
            for i in set(points) - kept:
                data.contact[i].exclude = marked = True
        return marked


def picked(compiled: Any, model: Any, rule: Callable[[int, int], bool]) -> int:
    """Of how many episodes the cube ends 10 cm above where it lay."""
    plan = Plan(model=model, fields={}, options=LAW, mujoco={"iterations": 200, "tolerance": 1e-12}, compiled=compiled)
    now, drive = Thinned(plan, EPISODES, rule), Trained()
    qpos, qvel = hand.start(now, cones.study.generators(range(EPISODES)))
    now.start(qpos, qvel, None, cones.study.seed)
    before = now.body("cube")[:, 2].copy()
    drive.begin(now)
    for _ in range(round(cones.study.seconds / hand.HOLD)):
        now.advance(drive(now), round(hand.HOLD / now.timestep))
    return int((now.body("cube")[:, 2] - before >= 0.1).sum())


if __name__ == "__main__":
    scene = cones.scene()
    for geom in range(scene.ngeom):
        if scene.geom(geom).name.startswith(("cube", "hand_finger")):
            scene.geom_friction[geom, 0] = FRICTION
    warnings.filterwarnings("ignore", category=stepper.ModelWarning)
    loaded = stepper.load(scene)
    for name, rule in RULES.items():
        print(f"{name}: {picked(scene, loaded, rule)} of {EPISODES} cubes")
