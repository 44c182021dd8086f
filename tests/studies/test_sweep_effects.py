"""A sweep of a parameter that another one hides is an error."""

import pytest
import stepper
from stepper.lab.study.parameters import Parameter, check_effects

MODEL = stepper.load("""<mujoco><worldbody><geom name="floor" type="plane" size="1 1 1"/>
<body><freejoint/><geom name="ball" size=".1"/></body>
</worldbody></mujoco>""")
VARIED = Parameter("geom_friction[*][0]", low=0.2, high=1.0)
ALL, FLOOR, BALL = (Parameter(f"geom_friction[{names}][0]", values=(0.3,), nominal=0.3) for names in ("*", "floor", "ball"))


@pytest.mark.parametrize(("later", "named"), [
    ({"all": ALL}, "because 'all' sets"),
    ({"one": FLOOR, "other": BALL}, "because 'one' and 'other' set"),
])  # fmt: skip
def test_what_sets_all_numbers_of_a_varied_parameter_after_it_is_named(later, named):
    with pytest.raises(ValueError, match=f"a sweep of 'friction' changes nothing, {named}"):
        check_effects(["friction"], {"friction": VARIED, **later}, MODEL)


@pytest.mark.parametrize("parameters", [
    {"friction": VARIED, "one": FLOOR},  # The ball's friction still varies.
    {"all": ALL, "friction": VARIED},  # The varied one applies last.
    {"friction": VARIED, "all": Parameter("geom_friction[*][0]", low=0.1, high=1.0)},  # It applies only where it is varied itself.
    {"friction": VARIED, "all": Parameter("geom_friction[*][0]", values=(0.3,), nominal=0.3, operation="scale")},
])  # fmt: skip
def test_what_leaves_an_effect_is_accepted(parameters):
    check_effects(["friction"], parameters, MODEL)
