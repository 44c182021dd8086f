"""Names of arrays of a stepper: fields of the model that environments may vary, those that explicit pairs override, applied inputs."""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from stepper._stepper import Model

RANDOMIZED: dict[str, str] = {
    "gravity": "", "body_mass": "body", "body_ipos": "body", "body_inertia": "body", "geom_friction": "geom", "geom_restitution": "geom",
    "pair_friction": "pair", "pair_restitution": "pair", "geom_size": "geom", "geom_pos": "geom", "jnt_stiffness": "joint",
    "jnt_range": "joint", "dof_damping": "dof", "dof_armature": "dof", "dof_frictionloss": "dof", "actuator_gain": "actuator",
    "actuator_bias": "actuator",
}  # fmt: skip
"""Fields of `Stepper.randomize`, and the kind of element whose rows they have."""
APPLIED = ("qfrc_applied", "xfrc_applied", "mocap_pos", "mocap_quat", "eq_active")
"""Arrays of a stepper that users write and every step reads, in the order of a pickled stepper."""
OF_PAIRS: dict[str, str] = {"geom_friction": "pair_friction", "geom_restitution": "pair_restitution"}
"""Fields of geoms that contacts of an explicit pair have from the pair instead, and the pair's fields."""


def check_pairs(model: Model, field: str, geoms: Collection[int], pairs: Collection[int], remedy: str) -> None:
    """Checks that no explicit pair overrides a field of some geoms.

    Args:
        model: The scene.
        field: A field of geoms, as "geom_friction".
        geoms: Geoms whose numbers change.
        pairs: Pairs whose own field changes too, which is allowed.
        remedy: What to do, with {pair} where the label of the pair belongs.

    Raises:
        ValueError: A pair that overrides the field of one of the geoms, with the remedy.
    """
    for k in range(model.npair if field in OF_PAIRS else 0):
        pair = model.pair(k)
        ends = [pair.geom1, pair.geom2]
        if k in pairs or not set(ends) & set(geoms) or (field == "geom_friction" and pair.dim == 1):
            continue
        one, other = (model.geom(g).name or f"#{g}" for g in ends)
        label = pair.name or f"#{k}"
        raise ValueError(
            f'contacts of geoms "{one}" and "{other}" have the {OF_PAIRS[field]} of explicit pair "{label}", not their {field}; '
            + remedy.format(pair=label)
        )
