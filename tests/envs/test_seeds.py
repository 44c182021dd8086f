"""Seeds of runs: `reset(seed=s)` is Gymnasium's, and `stepper.envs.seeds` gives runs that share no environment."""

import pytest
import stepper.envs
from hypothesis import given
from hypothesis import strategies as st
from stepper.envs import StepperVectorEnv, seeds


@given(st.integers(0, 2**70), st.integers(0, 40), st.integers(0, 40))
def test_a_longer_list_begins_with_the_shorter_one(run, few, more):
    assert seeds(run, few + more)[:few] == seeds(run, few)
    assert all(0 <= seed < 2**64 for seed in seeds(run, more))


def test_runs_share_no_seed():
    """Of a million seeds of 1,000 runs, two are equal with a chance of 3e-8: 1e12 pairs over 2^64 seeds, halved."""
    drawn = [seed for run in range(1000) for seed in seeds(run, 1000)]
    assert len(set(drawn)) == len(drawn)
    assert seeds((3, 0), 5) != seeds((3, 1), 5)


def test_spread_runs_share_no_start_and_gymnasiums_share_nearly_all():
    def starts(seed):
        envs = StepperVectorEnv("HalfCheetah", 32)
        return {tuple(row) for row in envs.reset(seed=seed)[0].tolist()}

    assert len(starts(0) & starts(1)) == 31
    assert not starts(seeds(0, 32)) & starts(seeds(1, 32))


@pytest.mark.parametrize(
    ("run", "num_envs", "text"), [(-1, 3, "the seed of a run is -1"), (1.5, 3, "1.5"), ((1, "a"), 3, "'a'"), (1, -1, "num_envs")]
)
def test_wrong_seeds_are_named(run, num_envs, text):
    with pytest.raises((TypeError, ValueError), match=text):
        stepper.envs.seeds(run, num_envs)
