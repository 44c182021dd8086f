"""Terrains: tiles by seed and difficulty, the scene that they make, origins on the surface, and curricula over them."""

from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest
import stepper
from checks import raises
from hypothesis import given, settings, strategies as st
from stepper.envs import Reset, Rng, terrain
from stepper.envs.terrain import Terrain, TerrainCurriculum
from stepper.sensors import HeightField
from stepper.shared.streams import Streams

KINDS = {
    "flat": terrain.Flat(),
    "rough": terrain.RandomRough(),
    "slope": terrain.PyramidSlope(),
    "slope_inv": terrain.PyramidSlope(inverted=True),
    "stairs": terrain.PyramidStairs(),
    "stairs_inv": terrain.PyramidStairs(inverted=True),
    "wave": terrain.Wave(),
}
ROBOT = '<mujoco><worldbody><body name="base" pos="0 0 1"><freejoint/><geom name="ball" size=".1" mass="1"/></body></worldbody></mujoco>'
LINE = np.linspace(-4.0, 4.0, 81)

kinds = st.sampled_from(sorted(KINDS))
difficulties = st.floats(0.0, 1.0)
GROUND = Terrain(sub_terrains={"flat": terrain.Flat(proportion=3.0), "rough": terrain.RandomRough()}, num_rows=4, border_width=1.0)

BALL = stepper.Stepper(stepper.load('<mujoco><worldbody><body><freejoint/><geom size=".1"/></body></worldbody></mujoco>'))


def scene(ground):
    spec = mujoco.MjSpec.from_string(ROBOT)
    ground.add_to(spec)
    return spec.compile()


def tile(kind, difficulty, seed=0):
    return KINDS[kind].heights(LINE, LINE, 8.0, difficulty, np.random.default_rng(seed))


@settings(deadline=None, max_examples=20)
@given(st.lists(kinds, min_size=1, max_size=3, unique=True), st.integers(1, 3), st.integers(0, 2**32), st.sampled_from([0.0, 0.5, 2.0]))
def test_terrains_follow_from_their_arguments(names, num_rows, seed, border):
    """The same bits for the same arguments; and a tile does not depend on how many others there are."""
    given = {"num_rows": num_rows, "seed": seed, "border_width": border, "difficulty_range": (0.5, 0.5)}
    made = [Terrain(sub_terrains={name: KINDS[name] for name in names}, **given) for _ in range(2)]
    np.testing.assert_array_equal(made[0].elevation, made[1].elevation)
    more = Terrain(sub_terrains={name: KINDS[name] for name in [*names, "flat"]}, **(given | {"num_rows": num_rows + 1}))
    for row in range(num_rows):
        for column in range(len(names)):
            np.testing.assert_array_equal(made[0]._tile(row, column), more._tile(row, column))


def test_seeds_give_different_terrains():
    given = {"sub_terrains": {"rough": KINDS["rough"]}, "num_rows": 2, "border_width": 0.0, "difficulty_range": (1.0, 1.0)}
    ground = [Terrain(**given, seed=seed).elevation for seed in range(2)]
    assert (ground[0] != ground[1]).mean() > 0.8
    assert (ground[0][:, :80] != ground[0][:, 80:160]).mean() > 0.8  # Two tiles of one terrain.


@settings(deadline=None)
@given(kinds, difficulties, difficulties, st.integers(0, 2**32))
def test_levels_are_monotone_in_difficulty(kind, one, other, seed):
    """With the same random numbers a harder tile is at least as uneven."""
    easy, hard = (tile(kind, difficulty, seed) for difficulty in sorted((one, other)))
    assert np.ptp(hard) >= np.ptp(easy) - 1e-12
    assert np.abs(np.diff(hard)).max() >= np.abs(np.diff(easy)).max() - 1e-12


@pytest.mark.parametrize("kind", sorted(set(KINDS) - {"flat"}))
def test_the_hardest_is_harder_than_the_easiest(kind):
    easy, hard = tile(kind, 0.0), tile(kind, 1.0)
    assert np.ptp(hard) > 2.0 * np.ptp(easy) + 0.05


@settings(deadline=None, max_examples=20)
@given(st.lists(kinds, min_size=1, max_size=4, unique=True), st.integers(1, 4), st.integers(0, 2**32), st.sampled_from([0.05, 0.1, 0.2]))
def test_origins_are_on_the_surface_and_borders_at_zero(names, num_rows, seed, scale):
    ground = Terrain(sub_terrains={name: KINDS[name] for name in names}, num_rows=num_rows, seed=seed, horizontal_scale=scale, size=6.0)
    origins = ground.origins
    assert origins.shape == (num_rows, len(names), 3)
    np.testing.assert_array_equal(origins[..., 2], ground.height(origins[..., :2]))
    assert not ground.leaves(origins[..., :2]).any()
    x = 6.0 * (np.arange(num_rows) - (num_rows - 1) / 2)
    np.testing.assert_allclose(origins[:, 0, 0], x, atol=1e-12)
    # Lines between tiles, and the border around all. Heights have single precision of a few metres.
    lines = [[edge + 3.0, y] for edge in x for y in np.linspace(-ground.half[1], ground.half[1], 50)]
    np.testing.assert_allclose(ground.height(np.array(lines)), 0.0, atol=1e-6)
    assert (ground.height(ground.half + 1.0) == 0.0).all()
    assert ground.leaves(ground.half - 0.2)


def test_the_scene_has_the_same_heights():
    """As MuJoCo's rays meet them, to the single precision of its elevations; and by elements of MJCF as by MjSpec."""
    ground = Terrain(sub_terrains=KINDS, num_rows=2, border_width=1.0, seed=3)
    m = scene(ground)
    data = mujoco.MjData(m)
    data.qpos[:3] = 100.0
    mujoco.mj_forward(m, data)
    places = np.random.default_rng(0).uniform(-1, 1, (200, 2)) * ground.half
    met = np.array([-1], np.int32)
    expected = [5.0 - mujoco.mj_ray(m, data, [*xy, 5.0], [0.0, 0.0, -1.0], None, 1, -1, met, None) for xy in places]
    np.testing.assert_allclose(ground.height(places), expected, atol=1e-6)
    asset, geom = (ElementTree.tostring(element, encoding="unicode") for element in ground.elements())
    text = stepper.load(ROBOT.replace("<worldbody>", f"<asset>{asset}</asset><worldbody>{geom}"))
    for each in (stepper.load(m), text):
        read = HeightField(each, "terrain")
        np.testing.assert_allclose(read.elevation + each.geom("terrain").pos[2], ground.elevation, atol=1e-12)


def test_a_ball_comes_to_rest_on_the_field():
    """At the middle of each tile."""
    ground = Terrain(sub_terrains={name: KINDS[name] for name in ("flat", "stairs", "slope")}, num_rows=2, size=5.0, border_width=0.5)
    origins = ground.origins.reshape(-1, 3)
    sim = stepper.Stepper(stepper.load(scene(ground)), len(origins))
    sim.reset(qpos=np.hstack([origins + np.array([0.0, 0.0, 0.12]), np.tile([1.0, 0.0, 0.0, 0.0], (len(origins), 1))]))
    sim.step(nstep=300)
    # A ball of 0.1 m; MuJoCo's elevations have single precision.
    np.testing.assert_allclose(sim.qpos[:, 2] - origins[:, 2], 0.1, atol=1e-4)


def ground_of(**given):
    return Terrain(**({"sub_terrains": {"flat": terrain.Flat()}} | given))


def levels_of(**given):
    return TerrainCurriculum(**({"terrain": GROUND} | given))


@pytest.mark.parametrize(("kind", "given", "said"), [
    (ground_of, {"sub_terrains": {}}, "sub_terrains is empty"),
    (ground_of, {"num_rows": 0}, "num_rows is 0, must be a whole number"),
    (ground_of, {"num_rows": "3"}, "num_rows is '3', must be a whole number of at least 1"),
    (ground_of, {"size": "8"}, "size is '8', must be a number"),
    (ground_of, {"size": -8.0}, "size is -8.0, must be a finite number of at least 0"),
    (ground_of, {"size": np.nan}, "size is nan, must be a finite number"),
    (ground_of, {"horizontal_scale": None}, "horizontal_scale is None, must be a number"),
    (ground_of, {"difficulty_range": 0.5}, "difficulty_range is 0.5, must be two numbers"),
    (ground_of, {"seed": 1.5}, "seed is 1.5, must be a whole number of at least 0"),
    (ground_of, {"seed": -1}, "seed is -1, must be a whole number of at least 0"),
    (ground_of, {"size": 8.05}, "size is 8.05 m, must be a whole number of cells of 0.1 m"),
    (ground_of, {"border_width": 0.25}, "border_width is 0.25 m"),
    (ground_of, {"horizontal_scale": 0.0}, "horizontal_scale is 0.0"),
    (ground_of, {"difficulty_range": (0.5, 0.2)}, "difficulty_range"),
    (terrain.Wave, {"border_width": -1.0}, "border_width of Wave is -1.0, must be a finite number of at least 0"),
    (terrain.Flat, {"proportion": "8"}, "proportion of Flat is '8', must be a number"),
    (terrain.RandomRough, {"height_range": 0.1}, r"height_range of RandomRough is 0.1, must be two numbers, such as \(0.0, 0.1\)"),
    (terrain.RandomRough, {"height_range": (-0.1, 0.1)}, "height_range of RandomRough is -0.1, must be a finite number of at least 0"),
    (terrain.RandomRough, {"spacing": 0.0}, "spacing of RandomRough is 0.0, must be a finite number above 0"),
    (terrain.Wave, {"num_waves": None}, "num_waves of Wave is None, must be a whole number"),
    (levels_of, {"terrain": None}, "terrain is None, must be a stepper.envs.terrain.Terrain"),
    (levels_of, {"max_init_level": 0.5}, "max_init_level is 0.5, must be a whole number"),
    (levels_of, {"spread": "near"}, "spread is 'near', must be a number"),
])  # fmt: skip
def test_wrong_arguments_are_errors(kind, given, said):
    raises((TypeError, ValueError), said, kind, **given)


def begin(levels, state, streams, envs):
    """Initial states of environments on their tiles."""
    rows = {name: values[envs] for name, values in state.items()}
    reset = Reset(BALL, envs, rows, Rng(streams, envs))
    reset.qpos = 0.0
    levels.place(reset)
    for name, values in state.items():
        values[envs] = rows[name]
    return reset.qpos


@settings(deadline=None, max_examples=50)
@given(st.integers(0, 5), st.integers(0, 2**32), st.lists(st.tuples(st.integers(0, 7), st.booleans(), st.booleans()), max_size=30))
def test_levels_stay_within_the_rows(first, seed, moves):
    """Whatever goes up and down; the tile of an environment is that of its level, and its column stays."""
    levels = TerrainCurriculum(terrain=GROUND, max_init_level=first)
    state, streams = levels.episode_state(8), Streams(8, seed)
    begin(levels, state, streams, np.arange(8))
    kinds = state["terrain_type"].copy()
    assert (state["terrain_level"] <= first).all()
    for env, up, down in moves:
        envs, before = np.array([env]), state["terrain_level"][env]
        levels.move(state, envs, up=np.array([up]), down=np.array([down]))
        assert state["terrain_level"][env] == np.clip(before + (1 if up else -1 if down else 0), 0, 4)
        qpos = begin(levels, state, streams, envs)
        level = state["terrain_level"]
        assert ((level >= 0) & (level < 4)).all()
        np.testing.assert_array_equal(state["terrain_origin"], GROUND.origins[level, kinds])
        assert (np.abs(qpos[0, :2] - state["terrain_origin"][env, :2]) <= 0.5).all()
        assert qpos[0, 2] >= GROUND.height(qpos[0, :2]) - 1e-12
        np.testing.assert_array_equal(levels.distance(state, envs, qpos), np.hypot(*(qpos[0, :2] - state["terrain_origin"][env, :2])))
    np.testing.assert_array_equal(state["terrain_type"], kinds)


def test_levels_depend_on_the_stream_of_an_environment_alone():
    levels = TerrainCurriculum(terrain=GROUND)
    together, alone = levels.episode_state(5), levels.episode_state(5)
    begin(levels, together, Streams(5, 9), np.arange(5))
    streams = Streams(5, 9)
    for env in (3, 0, 4, 1, 2):
        begin(levels, alone, streams, np.array([env]))
    for name, values in together.items():
        np.testing.assert_array_equal(alone[name], values)


def test_columns_have_their_proportions():
    levels = TerrainCurriculum(terrain=GROUND, max_init_level=3)
    state = levels.episode_state(2000)
    begin(levels, state, Streams(2000, 0), np.arange(2000))
    # 2,000 draws of 0.75: a deviation of 0.01.
    assert abs((state["terrain_type"] == 0).mean() - 0.75) < 0.04
    counts = np.bincount(state["terrain_level"], minlength=4) / 2000
    assert (np.abs(counts - 0.25) < 0.04).all()


class Plateau(terrain.SubTerrain):
    """Kind of a user, without `@dataclass`, with an attribute that has no hash."""

    def __init__(self, height):
        super().__init__()
        object.__setattr__(self, "values", np.array([height]))

    def heights(self, x, y, size, difficulty, rng):
        return np.full((len(y), len(x)), self.values[0])


def test_terrains_are_equal_if_their_ground_is():
    def made(height=0.1, **given):
        return terrain.Terrain(sub_terrains={"plateau": Plateau(height), "flat": terrain.Flat()}, num_rows=2, size=2.0, **given)

    assert made() == made()
    assert hash(made()) == hash(made())
    others = [made(0.4), made(border_width=1.0), made(horizontal_scale=0.2), "terrain"]
    others.append(terrain.Terrain(sub_terrains={"flat": terrain.Flat(), "plateau": Plateau(0.1)}, num_rows=2, size=2.0))
    assert all(made() != other for other in others)


def test_wrong_kinds_of_terrain_are_errors_that_name_them():
    for kinds in ([terrain.Flat()], {"flat": terrain.Flat}, {"flat": "flat"}):
        raises(TypeError, r"sub_terrains is .* must be a mapping from names to kinds", terrain.Terrain, sub_terrains=kinds)
    with pytest.raises(ValueError, match=r"heights of sub_terrain 'plateau' \(Plateau\) in row 0 .* must be 81 x 81 numbers"):
        _ = terrain.Terrain(sub_terrains={"plateau": Plateau(np.nan)}).elevation
