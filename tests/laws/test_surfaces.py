"""Surfaces of triangles: without friction, what glides over their seams keeps its energy, and a mesh rests on a plane."""

from functools import cache

import numpy as np
import pytest
import stepper

HALF, BEND, RADIUS, G = 0.5, 0.5, 0.1, 9.81
"""m, 1/m, m, m/s^2."""
KINDS = ("hfield", "mesh", "mesh, other diagonals")
GROUNDS = [("hfield", 11), ("hfield", 41), ("hfield", 161), *((kind, points) for kind in KINDS[1:] for points in (11, 41))]
FREE = '<freejoint/><geom type="sphere" size=".1" condim="1"/>'
SLIDES = '<joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/>'
GLIDERS = {
    "ball": (FREE, RADIUS),
    "capsule along": (SLIDES + '<geom type="capsule" size=".05 .08" euler="0 90 0" condim="1"/>', 0.05),
    "capsule across": (SLIDES + '<geom type="capsule" size=".05 .08" euler="90 0 0" condim="1"/>', 0.05),
    "box": (SLIDES + '<geom type="box" size=".06 .05 .04" condim="1"/>', 0.04),
    "turned box": (SLIDES + '<geom type="box" size=".06 .05 .04" euler="0 0 30" condim="1"/>', 0.04),
    "cylinder": (SLIDES + '<geom type="cylinder" size=".05 .04" condim="1"/>', 0.04),
    "hull": (SLIDES + '<geom type="mesh" mesh="octahedron" condim="1"/>', 0.05),
}
"""Joints and geom, and how far it reaches below its centre."""


@cache
def model(kind: str, points: int, glider: str) -> stepper.Model:
    line = np.linspace(-HALF, HALF, points)
    x, y = np.meshgrid(line, line)
    z = BEND * (HALF**2 - y**2)
    if kind == "hfield":
        # MuJoCo reads rows from the far side.
        numbers = " ".join(map(repr, (z[::-1] / z.max()).ravel().tolist()))
        size = f"{HALF} {HALF} {float(z.max())!r} .1"
        asset = f'<hfield name="ground" nrow="{points}" ncol="{points}" size="{size}" elevation="{numbers}"/>'
    else:
        corner = np.arange(points**2).reshape(points, points)
        p, q, s, t = corner[:-1, :-1], corner[:-1, 1:], corner[1:, 1:], corner[1:, :-1]
        faces = [p, q, s, p, s, t] if kind == "mesh" else [p, q, t, q, s, t]
        vertices = " ".join(map(repr, np.stack([x, y, z], axis=-1).ravel().tolist()))
        asset = f'<mesh name="ground" inertia="shell" vertex="{vertices}" face="{" ".join(map(str, np.stack(faces, axis=-1).ravel()))}"/>'
    ground = '<geom type="hfield" hfield="ground" condim="1"/>' if kind == "hfield" else '<geom type="mesh" mesh="ground" condim="1"/>'
    octahedron = '<mesh name="octahedron" vertex=".05 0 0 -.05 0 0 0 .05 0 0 -.05 0 0 0 .05 0 0 -.05"/>'
    loaded = stepper.load(f"""<mujoco><asset>{asset}{octahedron}</asset><worldbody>{ground}
        <body><inertial pos="0 0 0" mass="1" diaginertia=".004 .004 .004"/>{GLIDERS[glider][0]}</body></worldbody></mujoco>""")
    return loaded if kind == "hfield" else loaded.replace(geom_concave=[1.0, 0.0])


def along_the_crest(ground: tuple[str, int], glider: str, timestep: float, integrator: str, speed: float) -> float:
    """Share of the kinetic energy that is left after 0.3 s."""
    options = stepper.Options(timestep=timestep, integrator=integrator)
    sim = stepper.Stepper(model(*ground, glider), options=options)
    top = BEND * HALF**2 + GLIDERS[glider][1]
    if sim.model.nv == 6:
        sim.set_state([-0.3, 0, top, 1, 0, 0, 0], [speed, 0, 0, 0, 0, 0])
    else:
        sim.set_state([-0.3, top], [speed, 0])
    sim.step(nstep=round(0.3 / timestep))
    assert not np.any(sim.status)
    up, v = sim.qpos[2 if sim.model.nv == 6 else 1] - top, sim.qvel[: 3 if sim.model.nv == 6 else 2]
    return float(v @ v / 2 + G * up) / (speed**2 / 2)


@pytest.mark.parametrize("integrator", ["euler", "midpoint"])
@pytest.mark.parametrize("ground", GROUNDS)
def test_a_ball_glides_along_a_crest_for_ever(ground, integrator):
    for timestep in (1e-3, 2e-3, 5e-3, 1e-2):
        for speed in (0.1, 0.5, 1.0):
            # Heights of assets are in single precision, and a ball on a crest is in no stable balance.
            assert along_the_crest(ground, "ball", timestep, integrator, speed) == pytest.approx(1, abs=1e-5)


@pytest.mark.parametrize("glider", GLIDERS)
@pytest.mark.parametrize("kind", KINDS)
def test_whatever_glides_along_a_crest_is_not_braked(kind, glider):
    for timestep in (2e-3, 1e-2):
        # Where it rests, assets in single precision decide; the energy of 1e-7 m of height is 1e-5 of the kinetic.
        assert along_the_crest((kind, 41), glider, timestep, "midpoint", 0.5) == pytest.approx(1, abs=1e-4)


PYRAMID = 'vertex="-.1 -.1 0 .1 -.1 0 .1 .1 0 -.1 .1 0 0 0 .1" face="0 2 1 0 3 2 0 1 4 1 2 4 2 3 4 3 0 4"'  # a square base and four sides


@pytest.mark.parametrize("concave", [False, True])
@pytest.mark.parametrize("joint", ["<freejoint/>", '<joint type="slide" axis="0 0 1"/>'])
def test_a_mesh_that_does_not_rotate_stays_on_a_plane(joint, concave):
    """Without rotation a plane's infinite size must not spoil the bound on the approach: 0 times infinity is NaN."""
    model = stepper.load(f"""
    <mujoco><option timestep=".005"/><asset><mesh name="pyramid" {PYRAMID}/></asset><worldbody>
      <geom type="plane" size="5 5 .1"/>
      <body pos="0 0 .1">{joint}<inertial pos="0 0 .03" mass="1" diaginertia=".01 .01 .01"/><geom type="mesh" mesh="pyramid"/></body>
    </worldbody></mujoco>""")
    sim = stepper.Stepper(model.replace(geom_concave=[False, concave]), 2)
    for _ in range(100):
        sim.step()
    height = sim.qpos[:, 2] if "free" in joint else sim.qpos[:, 0] + 0.1
    np.testing.assert_allclose(height, 0.0, atol=1e-6)  # of 1 m after a fall of 0.5 s
    assert not np.any(sim.status)
