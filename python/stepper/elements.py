"""Elements of a model, as `Model.body`, `Model.joint` and others return them."""

from stepper._stepper import Actuator, Body, Equality, Geom, Joint, Keyframe, Pair, Sensor, Site, Tendon

__all__ = ["Actuator", "Body", "Equality", "Geom", "Joint", "Keyframe", "Pair", "Sensor", "Site", "Tendon"]
