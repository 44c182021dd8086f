"""Error against cost of fixed time steps and of steps that keep an error (`Options.error`), for docs/how-to/keep_an_error.md.

`python benches/error_control.py` prints one table per scene. The error of a step is the largest difference of a coordinate from 64 small
steps from the same state, as the 95 % quantile over steps and environments. The error at the end of 0.4 s, the median over environments, is
the difference from a run with a 64th of the time step. Costs are processor times relative to the model's own time step, of a batch of 16
environments and of one environment.
"""

import time

import numpy as np
import stepper
from sections import Table
from stepper import Options

SECONDS, ENVS, REPEATS = 0.4, 16, 3


def chain(links: int) -> str:
    """MJCF of a chain of light links with a heavy end."""
    body = '<geom type="sphere" size=".03" pos="0 0 -.1" mass="5"/>'
    for _ in range(links):
        link = '<joint axis="0 1 0"/><geom type="capsule" size=".01" fromto="0 0 0 0 0 -.1" mass=".02"/>'
        body = f'<body pos="0 0 -.1">{link}{body}</body>'
    head = '<option timestep=".002"/><default><geom contype="0" conaffinity="0"/></default>'
    return f"<mujoco>{head}<worldbody>{body}</worldbody></mujoco>"


BOXES = """<mujoco><option timestep=".005"/><worldbody>
  <geom type="plane" size="5 5 1"/><body pos="0 0 .6"><freejoint/>
  <geom type="box" size=".1 .15 .2" mass="1" friction="0"/></body></worldbody></mujoco>"""
ARM = """<mujoco><option timestep=".002"/><worldbody>
  <body><joint name="a" axis="0 1 0"/><geom type="capsule" size=".03" fromto="0 0 0 0 0 .4" mass="2"/>
    <body pos="0 0 .4"><joint name="b" axis="0 1 0"/><geom type="capsule" size=".02" fromto="0 0 0 0 0 .3" mass=".5"/></body></body>
  </worldbody><actuator><position joint="a" kp="400" kv="20"/><position joint="b" kp="400" kv="5"/></actuator></mujoco>"""


def scenes() -> dict:
    """Model, initial state and controls of each scene."""
    rng, found = np.random.default_rng(0), {}
    for links in (20, 40):
        model = stepper.load(chain(links))
        start = rng.uniform(-0.5, 0.5, (ENVS, model.nq)) + np.pi / 2 / model.nq
        found[f"chain of {links} links"] = model, {"qpos": start}, None
    quat = rng.normal(size=(ENVS, 4))
    model = stepper.load(BOXES)
    pos = np.tile([0, 0, 0.6], (ENVS, 1))
    state = {
        "qpos": np.concatenate([pos, quat / np.linalg.norm(quat, axis=1, keepdims=True)], axis=1),
        "qvel": np.concatenate([np.zeros((ENVS, 3)), 6 * rng.normal(size=(ENVS, 3))], axis=1),
    }
    found["elastic box that tumbles"] = model.replace(geom_restitution=np.ones(model.ngeom)), state, None
    model = stepper.load(ARM)
    found["servo arm"] = model, {"qpos": rng.uniform(-1, 1, (ENVS, 2))}, rng.uniform(-1, 1, (ENVS, 2))
    return found


def run(model, state, ctrl, num_envs=ENVS, **options) -> tuple[np.ndarray, float, float]:
    """Configuration at the end, seconds of processor time, and substeps per step."""
    spent, parts = [], 1.0
    for _ in range(REPEATS):
        sim = stepper.Stepper(model, num_envs, options=Options(**options), threads=1)
        sim.set_state(**{name: rows[:num_envs] for name, rows in state.items()})
        begin = time.process_time()
        sim.step(None if ctrl is None else ctrl[:num_envs], nstep=round(SECONDS / sim.timestep))
        spent.append(time.process_time() - begin)
        if sim.options.error is not None:
            parts = float(np.mean(sim.substeps)) / round(SECONDS / sim.timestep)
    return sim.qpos, float(np.median(spent)), parts


def error_of_a_step(model, state, ctrl, **options) -> float:
    """The 95 % quantile of the error of a step, or of as many steps as the model's own time step has."""
    h = model.timestep
    sim = stepper.Stepper(model, ENVS, options=Options(**options))
    fine = stepper.Stepper(model, ENVS, options=Options(timestep=h / 64))
    sim.set_state(**state)
    errors = []
    for _ in range(round(SECONDS / h)):
        fine.set_state(qpos=sim.qpos, qvel=sim.qvel)
        sim.step(ctrl, nstep=round(h / sim.timestep))
        fine.step(ctrl, nstep=64)
        errors.append(np.abs(sim.qpos - fine.qpos).max(axis=1))
    return float(np.quantile(errors, 0.95))


def main() -> None:
    """Prints the tables."""
    for name, (model, state, ctrl) in scenes().items():
        h = model.timestep
        reference = run(model, state, ctrl, timestep=h / 64)[0]
        print(f"\n{name}, {1e3 * h:g} ms\n")
        table = Table("settings", "substeps", "error of a step", "error at the end", "cost, 16 environments", "cost, one")
        rows = [(f"`timestep={h / k:g}`", {"timestep": h / k}) for k in (1, 2, 4, 8)]
        rows += [(f"`error={e:g}`", {"error": e}) for e in (1e-2, 1e-3, 1e-4)]
        base = None
        for label, options in rows:
            end, spent, parts = run(model, state, ctrl, **options)
            alone = run(model, state, ctrl, num_envs=1, **options)[1]
            base = base or (spent, alone)
            local, final = error_of_a_step(model, state, ctrl, **options), np.median(np.abs(end - reference).max(axis=1))
            table.add(label, f"{parts:.1f}", f"{local:.1e}", f"{final:.1e}", f"{spent / base[0]:.1f}", f"{alone / base[1]:.1f}")


if __name__ == "__main__":
    main()
