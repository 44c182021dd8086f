"""Scenes with a Sawyer arm that opens a drawer (metaworld), and with two arms that push a peg and a socket (gym-aloha)."""

from typing import Any

import mujoco
import numpy as np

from many_contacts.assets import Assets
from many_contacts.kinematics import eased, reach
from many_contacts.scene import Array, Phase, Scene, Script, still

HANDLE = np.array([0.0, 0.74, 0.09])
"""Centre of the drawer's handle, m."""
BESIDE = np.array([0.0, -0.003, 0.02])
"""Displacement from the handle to the lowered hand, with one finger on each side of the bar, m."""
ABOVE, PULL = np.array([0.0, 0.0, 0.12]), np.array([0.0, -0.12, 0.0])
SAWYER = (Phase("settles", 40, timed=False), Phase("reaches", 200), Phase("pulls", 200))
BENT = (1.39, -0.75, -0.07, 1.06, 0.05, 1.26, 3.16)
"""Initial guess of Sawyer's joint angles for the inverse kinematics, rad. The reference pose is outside the joint ranges."""
DOWN = np.array([1.0, 0.0, 1.0, 0.0]) / np.sqrt(2)
"""Orientation of the mocap body that guides Sawyer's hand (`sawyer_xyz_env.py`), a quaternion."""
HOLD = 5
"""Number of steps for which a target of the hand is held, metaworld's `frame_skip`."""


def sawyer(assets: Assets) -> Any:
    """Model specification (`MjSpec`) of metaworld's Sawyer arm with a drawer; the time step is 2.5 ms, as in metaworld's model.

    The hand is welded to a mocap body, with the weld data that metaworld's `reset_mocap_welds` sets.
    """
    s = assets.spec("metaworld", "metaworld/assets/sawyer_xyz/sawyer_drawer.xml")
    s.body("hand").add_site(name="hand")
    for weld in s.equalities:
        weld.data[:11] = [0, 0, 0, 0, 0, 0, -1, 0, 0, 0, 5]
    return s


def open_drawer(model: mujoco.MjModel, num_envs: int, rng: np.random.Generator) -> Script:
    """Initial states and controls of an episode (a `Script`) in which the hand opens the drawer.

    The hand moves down to a random place along the handle, and pulls.
    """
    target = HANDLE + BESIDE + np.concatenate([rng.uniform(-0.02, 0.02, (num_envs, 1)), np.zeros((num_envs, 2))], axis=1)
    starts, rot = still(model.qpos0, num_envs), np.zeros(9)
    mujoco.mju_quat2Mat(rot, DOWN)
    joints = [f"right_j{i}" for i in range(7)]
    starts[:, [int(model.joint(name).qposadr[0]) for name in joints]] = BENT
    for env in range(num_envs):
        starts[env] = reach(model, starts[env], "hand", joints, pos=target[env] + ABOVE, rot=rot.reshape(3, 3))
    still_there, *blocks = [phase.steps // HOLD for phase in SAWYER]
    way = [eased(target + ABOVE, target, blocks[0]), eased(target, target + PULL, blocks[1])]
    pos = np.concatenate([np.repeat((target + ABOVE)[None], still_there, axis=0), *way])
    quat = np.broadcast_to(DOWN, (*pos.shape[:2], 4))
    ctrl = np.tile([-1.0, 1.0], (1, num_envs, 1))
    return Script(starts, ctrl, hold=HOLD, mocap=np.concatenate([pos, quat], axis=-1)[:, :, None])


ALOHA = (Phase("comes", 300, timed=False), Phase("pushes", 300))
ARM = ("waist", "shoulder", "elbow", "forearm_roll", "wrist_angle", "wrist_rotate")
ARMS = {"right": ("peg", 0.01), "left": ("socket", 0.022)}
"""Object in front of each arm, and height of its centre when it lies on the table, m."""
WAYPOINTS = 4
"""Number of random targets of each hand in the phase "pushes"."""
SPREAD = np.array([0.03, 0.03, 0.005])
"""Half ranges of the random hand positions about the object in x, y and z, m."""
DRY, DAMPING = 0.05, 0.07
"""Factor on the dry friction of ALOHA's joints; and damping of a joint divided by the stiffness of its servo, s."""
STEEP = 0.9
"""Downward inclination of the hands, rad."""


def aloha(assets: Assets) -> Any:
    """Model specification (`MjSpec`) of ALOHA's two arms with peg and socket on a table.

    A site is added between the fingers of each hand.

    In the package's model the joints have dry friction of 30 to 60 N m (30 N in the fingers) and no damping. MuJoCo's dry friction is soft,
    so the joints creep. The servos cannot overcome exact dry friction: the fingers press with at most 7 N. This model therefore replaces
    most of the dry friction by damping.
    """
    s = assets.spec("gym-aloha", "gym_aloha/assets/bimanual_viperx_insertion.xml")
    for act in s.actuators:
        joint = s.joint(act.target)
        joint.frictionloss *= DRY
        joint.damping[0] = DAMPING * act.gainprm[0]
    for side in ARMS:
        s.body(f"vx300s_{side}/gripper_link").add_site(name=f"{side}_grip", pos=[0.15, 0, 0])
    return s


def push(model: mujoco.MjModel, num_envs: int, rng: np.random.Generator) -> Script:
    """Initial states and controls of an episode (a `Script`) in which two hands push a peg and a socket.

    The hands, with closed fingers, move down to the peg and the socket, and move randomly there.
    """
    home: Array = model.key_qpos[0].copy()
    home[[-5, -12]] = ARMS["left"][1], ARMS["right"][1]
    starts = still(home, num_envs)
    starts[:, [-14, -13, -7, -6]] += rng.uniform(-0.02, 0.02, (num_envs, 4))
    blocks = [ALOHA[0].steps // HOLD, *[ALOHA[1].steps // HOLD // WAYPOINTS] * WAYPOINTS]
    targets = np.tile(home[: model.nu], (WAYPOINTS + 2, num_envs, 1))
    offsets = rng.uniform(-SPREAD, SPREAD, (WAYPOINTS + 1, num_envs, len(ARMS), 3))
    for env in range(num_envs):
        for i, (side, (thing, height)) in enumerate(ARMS.items()):
            joints = [f"vx300s_{side}/{name}" for name in ARM]
            adr = [int(model.joint(name).qposadr[0]) for name in joints]
            place = np.array([*starts[env, _place(model, thing)][:2], height + SPREAD[2]])
            qpos = home
            for k in range(WAYPOINTS + 1):
                pos = place + offsets[k, env, i]
                rot = _pointing(pos - model.body(f"vx300s_{side}").pos)
                qpos = reach(model, qpos, f"{side}_grip", joints, pos=pos, rot=rot)
                targets[k + 1, env, adr] = qpos[adr]
    ways = zip(targets[:-1], targets[1:], blocks, strict=True)
    return Script(starts, np.concatenate([eased(begin, end, n) for begin, end, n in ways]), hold=HOLD)


def _pointing(way: Array) -> Array:
    """Rotation matrix (3, 3) of a hand whose x axis has the horizontal direction of `way` (3,), inclined downwards by `STEEP`."""
    along = np.array([way[0], way[1], 0.0]) / np.hypot(way[0], way[1])
    down = np.cos(STEEP) * along - np.array([0.0, 0.0, np.sin(STEEP)])
    across = np.array([-along[1], along[0], 0.0])
    return np.stack([down, across, np.cross(down, across)], axis=1)


def _place(model: mujoco.MjModel, body: str) -> slice:
    """Columns of qpos with the position and orientation of a free body."""
    adr = int(model.jnt_qposadr[model.body(body).jntadr[0]])
    return slice(adr, adr + 7)


SCENES = (
    Scene("drawer", "metaworld's Sawyer opens a drawer by its handle, 2.5 ms", sawyer, open_drawer, SAWYER),
    Scene(
        "two arms",
        "gym-aloha's bimanual cell: two ViperX arms, dry friction in every joint, push a peg and a socket, 2 ms",
        aloha,
        push,
        ALOHA,
    ),
)
