"""SimBenchmark's seven public tests, written anew: benches/atlas/scenes/simbenchmark.py."""

from atlas_cases import cases, check


@cases("S1")
def test_rolling(scene, engine, dt):
    check(scene, engine, dt)


@cases("S2")
def test_bouncing(scene, engine, dt):
    check(scene, engine, dt)


# Steps of 1 ms take seconds: the other settings have the same contact law and solver as these.
@cases("S3", others=["stepper euler", "stepper newton"])
def test_666(scene, engine, dt):
    check(scene, engine, dt)


@cases("S4")
def test_elastic_666(scene, engine, dt):
    check(scene, engine, dt)


@cases("S5")
def test_momentum(scene, engine, dt):
    check(scene, engine, dt)


@cases("S6")
def test_energy(scene, engine, dt):
    check(scene, engine, dt)


@cases("S7")
def test_standing(scene, engine, dt):
    check(scene, engine, dt)
