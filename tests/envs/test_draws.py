"""Draws of `Rng`: shapes of tuples, and errors for the arguments and methods of NumPy's generators."""

import copy
import pickle

import numpy as np
import pytest
from cases import Slide
from hypothesis import given
from hypothesis import strategies as st
from stepper.envs import Observation, Rng, StepperVectorEnv
from stepper.shared.streams import Streams


def generator(num_envs=3):
    return Rng(Streams(num_envs, 5), np.arange(num_envs))


@given(st.integers(1, 5), st.lists(st.integers(0, 4), max_size=3).map(tuple))
def test_a_tuple_gives_the_numbers_of_its_product(num_envs, shape):
    size = int(np.prod(shape, dtype=int))
    for draw in (lambda rng, size: rng.uniform(-2.0, 3.0, size), lambda rng, size: rng.normal(size)):
        one, other = generator(num_envs), generator(num_envs)
        found = draw(one, shape)
        assert found.shape == (num_envs, *shape)
        np.testing.assert_array_equal(found.reshape(num_envs, size), draw(other, size))
        np.testing.assert_array_equal(one._streams.state, other._streams.state)


@given(st.floats() | st.text() | st.none() | st.tuples(st.floats()))
def test_another_size_is_an_error(size):
    for draw in (lambda: generator().uniform(0.0, 1.0, size), lambda: generator().normal(size)):
        with pytest.raises(TypeError, match=r"^size is .*, must be a whole number or a tuple of them"):
            draw()


@given(st.integers(max_value=-1))
def test_a_negative_size_is_an_error(size):
    with pytest.raises(ValueError, match=r"^size is \(3, -\d+\), must be at least 0"):
        generator().normal((3, size))


def test_generators_are_copied():
    for twin in (copy.deepcopy(generator()), pickle.loads(pickle.dumps(generator()))):
        np.testing.assert_array_equal(twin.normal(2), generator().normal(2))


def test_a_draw_of_a_wrong_shape_has_a_note_with_the_right_one():
    def draws(self, reset):
        np.zeros((3, 2))[:, 0] = reset.rng.uniform(0.0, 1.0, 3)

    with pytest.raises(ValueError, match="broadcast") as error:
        StepperVectorEnv(type("Own", (Slide,), {"reset": draws})(), 3).reset(seed=0)
    assert error.value.__notes__ == [
        "rng.uniform(low, high, size) has the shape (n, size), a row for each environment that resets: for one number each, write "
        "rng.uniform(low, high, 1)[:, 0]"
    ]
    np.zeros((3, 2))[:, 0] = generator().uniform(0.0, 1.0, 1)[:, 0]


@pytest.mark.parametrize(("make", "message"), [
    (lambda: Observation("sensordata", "acc"), "for elements by name, write func=lambda now: now.read('sensordata', 'acc')"),
    (lambda: Observation("xpos", ["a", "b"]), "write func=lambda now: now.read('xpos', ['a', 'b'])"),
    (lambda: Observation("qvel", clip=5.0), "clip of Observation 'qvel' is 5.0, must be a lower and an upper bound: clip=(-5.0, 5.0)"),
    (lambda: Observation("qpos", clip=(1, -1)), "clip of Observation 'qpos' is (1, -1), must be the lower bound and then the upper bound"),
    (lambda: Observation("qvel", clip=(1.0,)), "clip of Observation 'qvel' is (1.0,), must be a lower and an upper bound"),
    (lambda: Observation("qvel", noise=-1.0), "noise of Observation 'qvel' is -1.0, must be a finite number of at least 0"),
    (lambda: Observation("qvel", noise=(-1.0, 1.0)), "noise of Observation 'qvel' is (-1.0, 1.0), must be a number"),
])  # fmt: skip
def test_rows_of_other_libraries_are_errors_with_the_row_to_write(make, message):
    with pytest.raises((TypeError, ValueError)) as error:
        make()
    assert message in str(error.value)


def test_the_rows_of_the_hints_work():
    class Own(Slide):
        def observations(self):
            return (
                Observation("a", func=lambda now: 0.5 * now.qvel),
                Observation("b", func=lambda now: now.read("xpos", 1)),
                Observation("c", func=lambda now: now.qpos - now.default_qpos),
                Observation("qvel", clip=(-5.0, 5.0), columns=slice(0, 1), noise=0.1),
            )

    assert StepperVectorEnv(Own(), 2).reset(seed=0)[0].shape == (2, 6)


def test_two_rows_of_one_name_are_an_error():
    with pytest.raises(ValueError, match=r"Own\.observations returns two rows with the name 'qpos': give one another name"):
        StepperVectorEnv(type("Own", (Slide,), {"observations": lambda self: (Observation("qpos"), Observation("qpos"))})(), 2)
