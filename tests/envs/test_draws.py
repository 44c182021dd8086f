"""Draws of `Rng`, and errors of its arguments and of those of rows of observations."""

import copy
import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from stepper.envs import Observation, Rng, normal
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


@pytest.mark.parametrize(("make", "message"), [
    (lambda: Observation("qvel", "qpos"), "func of Observation 'qvel' is 'qpos', must be a function of now, or None"),
    *((lambda clip=clip: Observation("qvel", clip=clip), "must be the lower bound and then the upper bound") for clip in (5.0, (1.0,))),
    (lambda: Observation("qpos", clip=(1, -1)), "clip of Observation 'qpos' is (1, -1), must be the lower bound and then the upper bound"),
    (lambda: Observation("qvel", noise=-1.0), "noise of Observation 'qvel' is -1.0, must be a finite number of at least 0"),
    (lambda: Observation("qvel", noise=(-1.0, 1.0)), "noise of Observation 'qvel' is (-1.0, 1.0), must be a number"),
    (lambda: Observation("qpos", delay=(2, 1)), "delay of Observation 'qpos' is (2, 1), must be a whole number or a tuple of two"),
    (lambda: Observation("qpos", history=0), "history of Observation 'qpos' is 0"),
    (lambda: Observation("speed", lambda: 0), "func of Observation 'speed' is <lambda>(), must take 1 argument, now: write lambda now"),
    (lambda: Observation(3), "the name of an Observation is 3, must be a text: Observation(name, func=...)"),
    (lambda: normal(0.0, -1.0), "the latter at least 0"),
])  # fmt: skip
def test_wrong_rows_are_errors(make, message):
    with pytest.raises((TypeError, ValueError)) as error:
        make()
    assert message in str(error.value)
