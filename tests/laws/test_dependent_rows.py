"""Linearly dependent constraint rows: geometry makes rows dependent, mass ratios and chain length do not, in either precision.

A removed row whose constraint is violated shows in the residual or in the status.
"""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from models import flags_of, simulate
from stepper import Status

PRECISIONS = pytest.mark.parametrize("precision", ["f64", "f32"])
SEEDS = st.integers(0, 2**32 - 1)
GHOST = 'contype="0" conaffinity="0"'


def coupled_slides(light: float, heavy: float, *, radius: float = 0.05) -> str:
    """MJCF of a light sphere on the floor, whose slide joint is coupled to that of a heavy body without support."""
    return f"""<mujoco><worldbody><geom type="plane" size="3 3 1"/>
    <body pos="0 0 {radius}"><joint name="l" type="slide" axis="0 0 1"/><geom size="{radius}" mass="{light}"/></body>
    <body pos="1 0 1"><joint name="h" type="slide" axis="0 0 1"/><geom size=".05" mass="{heavy}" {GHOST}/></body></worldbody>
    <equality><joint joint1="l" joint2="h"/></equality></mujoco>"""


def cable(
    rods: int, *, length: float = 0.05, mass: float = 0.01, joint: str = 'type="ball"', curl: float = 0.0, tilt: str = "0 0 0"
) -> str:
    """MJCF of a chain of rods, rotated by `curl` degrees from one to the next. Its end is connected to its initial position."""
    body, end = "", "</body>" * rods
    for i in range(rods):
        place = f'pos="{length} 0 0" euler="0 {curl} 0"' if i else f'pos="0 0 1" euler="{tilt}"'
        body += (
            f'<body name="{i}" {place}><joint {joint}/><geom type="capsule" size=".001" fromto="0 0 0 {length} 0 0" mass="{mass}" {GHOST}/>'
        )
    return f"""<mujoco><worldbody>{body}{end}</worldbody>
    <equality><connect body1="{rods - 1}" body2="world" anchor="{length} 0 0"/></equality></mujoco>"""


def welded_through(light: float, heavy: float, *, tilt: str = "0 0 0") -> str:
    """MJCF of a heavy body that is welded to a light one, which is welded to the world."""
    return f"""<mujoco><worldbody>
    <body name="a" pos="0 0 1" euler="{tilt}"><freejoint/><geom type="box" size=".1 .1 .1" mass="{light}" {GHOST}/></body>
    <body name="b" pos=".5 0 1"><freejoint/><geom type="box" size=".3 .2 .3" mass="{heavy}" {GHOST}/></body></worldbody>
    <equality><weld body1="a" body2="world"/><weld body1="a" body2="b"/></equality></mujoco>"""


def pulley(wheel: float, load: float = 1.0) -> str:
    """MJCF of two loads on slides, coupled by a light wheel. The second load is 10 % heavier."""
    return f"""<mujoco><worldbody>
    <body pos="0 0 1"><joint name="w" axis="0 1 0"/><geom type="cylinder" size=".05 .01" euler="90 0 0" mass="{wheel}" {GHOST}/></body>
    <body pos=".05 0 0"><joint name="a" type="slide" axis="0 0 1"/><geom size=".02" mass="{load}" {GHOST}/></body>
    <body pos="-.05 0 0"><joint name="b" type="slide" axis="0 0 1"/><geom size=".02" mass="{1.1 * load}" {GHOST}/></body></worldbody>
    <equality><joint joint1="a" joint2="w" polycoef="0 .05 0 0 0"/><joint joint1="b" joint2="w" polycoef="0 -.05 0 0 0"/></equality>
    </mujoco>"""


def welded_foot(foot: float, load: float = 1.0, *, height: float = 0.02, half: str = ".05 .05", up: float = 0.2, shape: str = "box") -> str:
    """MJCF of a body that is welded to a light foot on the floor."""
    size = f"{half} {height}" if shape == "box" else f"{height}"
    return f"""<mujoco><option timestep=".002"/><worldbody><geom type="plane" size="3 3 1"/>
    <body name="a" pos="0 0 {up}"><freejoint/><geom type="box" size=".1 .1 .1" mass="{load}" {GHOST}/></body>
    <body name="f" pos="0 0 {height}"><freejoint/><geom type="{shape}" size="{size}" mass="{foot}"/></body></worldbody>
    <equality><weld body1="a" body2="f"/></equality></mujoco>"""


@PRECISIONS
@pytest.mark.parametrize("ratio", [1e-4, 9.9e-7, 1e-7, 1e-9])
def test_a_floor_holds_a_light_sphere_that_is_coupled_to_a_heavy_body(ratio, precision):
    sim = simulate(coupled_slides(10 * ratio, 10.0), precision=precision)
    assert not flags_of(sim, 500) & ~Status.NOT_CONVERGED
    # Twenty times the slop of contacts, m. Without the floor it falls 4.9 m.
    assert np.abs(sim.qpos).max() < 2e-4
    assert np.abs(sim.qvel).max() < 1e-4


@PRECISIONS
@pytest.mark.parametrize("curl", [0.0, 42.5])
def test_a_cable_of_four_rods_stays_connected(curl, precision):
    sim = simulate(cable(4, curl=curl), precision=precision)
    assert flags_of(sim, 200) == Status.OK
    # Without the connection the cable falls: a rod of 5 cm rotates by radians within 0.1 s.
    if curl == 0:
        assert np.abs(sim.qpos[1:4]).max() < 0.05


@PRECISIONS
@pytest.mark.parametrize("ratio", [1e2, 1e4, 1e6, 1e9])
@pytest.mark.parametrize("tilt", ["0 0 0", "20 30 40"])
def test_a_light_body_holds_a_heavy_one_by_welds(ratio, tilt, precision):
    sim = simulate(welded_through(1.0, ratio, tilt=tilt), precision=precision)
    start = np.array(sim.qpos)
    assert flags_of(sim, 300) == Status.OK
    # Rounding error of positions of 1 m in 32 bits over 300 steps. Without the weld it falls 1.8 m.
    assert np.abs(sim.qpos - start).max() < 1e-4


@PRECISIONS
@pytest.mark.parametrize("wheel", [1e-2, 1e-6, 1e-9])
def test_a_light_wheel_couples_the_loads_of_a_pulley(wheel, precision):
    sim = simulate(pulley(wheel), precision=precision)
    assert flags_of(sim, 300) == Status.OK
    rate = 0.1 * 9.81 / (2.1 + wheel / 2)  # Acceleration, m/s^2, with the inertia of the wheel as a mass at its rim.
    assert sim.qvel[1] == pytest.approx(0.6 * rate, rel=1e-4)
    assert sim.qvel[2] == pytest.approx(-0.6 * rate, rel=1e-4)


@PRECISIONS
@pytest.mark.parametrize("foot", [1e-2, 1e-3, 1e-4, 1e-5, 1e-7])
@pytest.mark.parametrize(("height", "half", "up"), [(0.02, ".1 .03", 0.2), (0.01, ".05 .05", 0.5), (0.05, ".1 .03", 0.2)])
def test_a_light_foot_carries_the_body_that_is_welded_to_it(height, half, up, foot, precision):
    sim = simulate(welded_foot(foot, height=height, half=half, up=up), precision=precision)
    for _ in range(1000):
        sim.step()
        assert not sim.status & ~Status.NOT_CONVERGED
    assert sim.qpos[2] == pytest.approx(up, abs=2e-4)  # Twenty times the slop, m.


def feasible(seed: int, precision: str) -> str:
    """MJCF of a random feasible scene: it starts without constraint violation."""
    rng = np.random.default_rng(seed)
    ratio, scale = 10.0 ** rng.uniform([0, -3], [9, 1])
    tilt = " ".join(f"{angle}" for angle in rng.uniform(-60, 60, 3))
    kind = rng.choice(["slides", "cable", "weld", "pulley", "foot"])
    if kind == "slides":
        return coupled_slides(scale, scale * ratio, radius=rng.uniform(0.01, 0.2))
    if kind == "cable":
        joint, whole = rng.choice(['type="ball"', 'axis="0 1 0"']), 2.0
        rods = rng.choice([3, 5, 9, 20, 40, 80, 160])
        if precision == "f32":
            # Longer chains exceed 32 bits: the inertia of one joint is too small compared with that of the chain. For ball joints that is
            # the spin of a rod of 1 mm about its axis, 1e-7 of the chain if five rods are 2 m long.
            rods, whole = (min(rods, 5), 0.25) if "ball" in joint else (min(rods, 40), whole)
        return cable(rods, length=whole / rods, mass=scale / rods, joint=joint, curl=rng.uniform(90, 250) / rods, tilt=tilt)
    if kind == "weld":
        return welded_through(scale, scale * ratio, tilt=tilt)
    if kind == "pulley":
        return pulley(scale / ratio, scale)
    return welded_foot(scale / ratio, scale, height=rng.uniform(0.01, 0.05), half=f"{rng.uniform(0.03, 0.1)} .04")


@PRECISIONS
@given(seed=SEEDS)
def test_feasible_scenes_are_never_flagged_as_infeasible(precision, seed):
    sim = simulate(feasible(seed, precision), precision=precision)
    assert not flags_of(sim, 40) & (Status.INFEASIBLE | Status.NON_FINITE | Status.UNRESOLVED)


def infeasible(seed: int) -> str:
    """MJCF of a random infeasible scene: a target 1 mm to 1 m out of reach, or two contradictory constraints."""
    rng = np.random.default_rng(seed)
    ratio, scale, gap = 10.0 ** rng.uniform([0, -3, -3], [9, 1, 0])
    kind = rng.choice(["reach", "slides", "welds", "locked limit", "slot", "plane"])
    if kind == "reach":
        rods = int(rng.integers(1, 6))
        geom = f'<geom type="capsule" size=".01" fromto="0 0 0 .2 0 0" mass="{scale}" {GHOST}/>'
        body = "".join(f'<body pos="{0.2 if i else 0} 0 0"><joint axis="0 1 0"/>{geom}' for i in range(rods))
        tip, end = '<site name="tip" pos=".2 0 0"/>', "</body>" * rods
        return f"""<mujoco><option gravity="0 0 0"/><worldbody><site name="far" pos="{0.2 * rods + gap} 0 0"/>{body}{tip}{end}</worldbody>
        <equality><connect site1="tip" site2="far"/></equality></mujoco>"""
    if kind == "slides":
        second = f'<joint joint1="l" joint2="h" polycoef="{gap} 1 0 0 0"/></equality>'
        return coupled_slides(scale, scale * ratio).replace("</equality>", second)
    if kind == "welds":
        place = f'<site name="here" pos="0 0 1"/><site name="there" pos="{gap} 0 1"/>'
        return f"""<mujoco><option gravity="0 0 0"/><worldbody>{place}<body pos="0 0 1"><freejoint/>
        <geom type="box" size=".1 .1 .1" mass="{scale}"/><site name="s"/></body></worldbody>
        <equality><weld site1="s" site2="here"/><weld site1="s" site2="there"/></equality></mujoco>"""
    if kind == "locked limit":
        return f"""<mujoco><worldbody><body><joint name="l" type="slide" axis="0 0 1" range="{gap} {gap + 1}"/>
        <geom size=".05" mass="{scale}" {GHOST}/></body></worldbody><equality><joint joint1="l"/></equality></mujoco>"""
    if kind == "slot":
        return f"""<mujoco><option gravity="0 0 0"/><worldbody>
        <geom type="box" size=".05 1 1" pos=".15 0 0"/><geom type="box" size=".05 1 1" pos="-.15 0 0"/>
        <body><joint type="slide" axis="1 0 0"/><geom type="box" size="{0.1 + min(gap, 0.03)} .05 .05" mass="{scale}"/></body>
        </worldbody></mujoco>"""
    # The end of a planar chain is connected to a point off its plane.
    return f"""<mujoco><option gravity="0 0 0"/><worldbody><site name="far" pos=".3 {gap} 0"/>
    <body><joint axis="0 1 0"/><geom type="capsule" size=".01" fromto="0 0 0 .2 0 0" mass="{scale}" {GHOST}/>
    <body pos=".2 0 0" euler="0 40 0"><joint axis="0 1 0"/>
    <geom type="capsule" size=".01" fromto="0 0 0 .2 0 0" mass="{scale}" {GHOST}/><site name="tip" pos=".2 0 0"/></body></body></worldbody>
    <equality><connect site1="tip" site2="far"/></equality></mujoco>"""


@PRECISIONS
@given(seed=SEEDS)
def test_infeasible_scenes_are_flagged(precision, seed):
    # The correction first moves as close as it can. The proof of infeasibility follows within 0.4 s, about twenty half-lives of a
    # position error.
    sim = simulate(infeasible(seed), precision=precision)
    sim.step(nstep=200)
    assert sim.status & Status.INFEASIBLE


def planar_loop(rods: int, tilt: str, times: int) -> str:
    """MJCF of a planar loop of rods on hinges, closed by `times` identical connect equalities in three dimensions."""
    length, turn = 2.0 / rods, 360 / rods * 0.9
    body = "".join(
        f'<body name="{i}" pos="{length if i else 0} 0 0" euler="0 {turn} 0"><joint axis="0 1 0"/>'
        f'<geom type="capsule" size=".01" fromto="0 0 0 {length} 0 0" mass="{1.0 / rods}" {GHOST}/>'
        for i in range(rods)
    )
    connect = f'<connect body1="{rods - 1}" body2="world" anchor="{length} 0 0"/>' * times
    return f"""<mujoco><worldbody><body euler="{tilt}">{body}{"</body>" * rods}</body></worldbody>
    <equality>{connect}</equality></mujoco>"""


@PRECISIONS
@pytest.mark.parametrize("tilt", ["0 0 0", "17 31 43", "80 5 61"])
@pytest.mark.parametrize("rods", [3, 6, 12, 24])
@pytest.mark.parametrize("times", [1, 2, 3])
def test_redundant_rows_of_a_planar_loop_are_removed_in_any_orientation(times, rods, tilt, precision):
    sim = simulate(planar_loop(rods, tilt, times), precision=precision)
    before = sum(sim.energy())
    status = flags_of(sim, 150)
    assert not status & ~Status.UNRESOLVED
    assert np.abs(sim.qvel).max() < 200
    # Energy error of a loop of 1 kg and 1 m by inertial forces at 2 ms, J.
    assert abs(sum(sim.energy()) - before) < 0.3


@PRECISIONS
@pytest.mark.parametrize("tilt", ["0 0 0", "17 31 43"])
def test_a_second_weld_of_the_same_bodies_changes_nothing(tilt, precision):
    once, twice = (
        welded_through(1.0, 1.0, tilt=tilt).replace("</equality>", more + "</equality>") for more in ("", '<weld body1="b" body2="a"/>')
    )
    sims = [simulate(xml, precision=precision) for xml in (once, twice)]
    for sim in sims:
        sim.set_state(qvel=np.linspace(-1, 1, 12))
        # The initial velocities violate the welds, and separate the bodies by 1 mm in the first half step.
        assert not flags_of(sim, 100) & ~Status.EQUALITY_VIOLATED
    # Rounding error of positions of 1 m.
    assert np.abs(sims[0].qpos - sims[1].qpos).max() < (1e-5 if precision == "f32" else 1e-12)
