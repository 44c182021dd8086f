"""The distribution that a recording of a robot gives is one that its policy can be evaluated under."""

from identified_cheetah import FRICTION, MASS, identified, nominal, recorded, returns, robot


def test_what_is_identified_is_the_robot_and_can_be_drawn_from(tmp_path):
    recorded(tmp_path / "run", runs=1)
    found = identified(tmp_path / "run")
    mass, friction = found.interval(0.999)
    # The model is far outside of what is said, the robot inside.
    assert mass[0] < MASS < mass[1]
    assert friction[0] < FRICTION < friction[1]
    assert mass[0] > nominal().body("torso").mass
    assert friction[1] < nominal().geom_friction[0][0]
    total = returns(found.sample(4), episodes=4, actions=5)
    assert total.shape == (4,)
    # The draws are what runs: other returns than the model's from the same starts.
    assert (total != returns({}, episodes=4, actions=5)).all()
    assert robot(nominal()).body("torso").mass == MASS
