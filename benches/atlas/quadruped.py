"""Model of a quadruped of ANYmal's size: 12 hinges, 34 kg, primitive shapes."""

from atlas.mjcf import document, numbers

POSE = (0.03, 0.4, -0.8, -0.03, 0.4, -0.8, 0.03, -0.4, 0.8, -0.03, -0.4, 0.8)
"""Joint angles of the standing quadruped in SimBenchmark, rad: hip, thigh, knee of left front, right front, left hind, right hind leg."""
STAND = 0.55
"""Height of the trunk's centre with the joint angles `POSE` and the feet 4 mm above the floor, m."""
THIGH, SHANK, FOOT = 0.25, 0.31, 0.03
HINGE = '<joint name="{name}" type="hinge" axis="{axis}"/>'


def _leg(name: str, front: int, left: int) -> str:
    """MJCF of a leg of the quadruped, with a hip about x, and thigh and knee about y. Only its foot collides.

    Args:
        name: Name of the leg.
        front: 1 for a front leg, -1 for a hind leg.
        left: 1 for a left leg, -1 for a right leg.
    """
    hinge = {
        part: HINGE.format(name=f"{name}_{part}", axis=axis) for part, axis in (("hip", "1 0 0"), ("thigh", "0 1 0"), ("knee", "0 1 0"))
    }
    ghost = 'contype="0" conaffinity="0"'
    return f"""<body name="{name}_hip" pos="{numbers((0.27 * front, 0.12 * left, 0))}">{hinge["hip"]}
        <geom {ghost} type="capsule" size=".04" fromto="0 0 0 {numbers((0.05 * front, 0.03 * left, 0))}" mass="1.1"/>
      <body name="{name}_thigh" pos="{numbers((0.06 * front, 0.08 * left, 0))}">{hinge["thigh"]}
        <geom {ghost} type="capsule" size=".035" fromto="0 0 0 0 0 -{THIGH}" mass="1.5"/>
      <body name="{name}_shank" pos="0 0 -{THIGH}">{hinge["knee"]}
        <geom {ghost} type="capsule" size=".015" fromto="0 0 0 0 0 -{SHANK}" mass=".32"/>
        <geom name="{name}_foot" type="sphere" size="{FOOT}" pos="0 0 -{SHANK}" mass=".19"/>
      </body></body></body>"""


LEGS = (("lf", 1, 1), ("rf", 1, -1), ("lh", -1, 1), ("rh", -1, -1))


def quadruped(
    *, gravity: float = 9.81, beside: str = "", friction: float = 0.8, gains: tuple[float, float] | None = None, torques: bool = False
) -> str:
    """MJCF of a scene with the robot, whose trunk starts 2 m above the origin.

    Without `gains` and `torques` the joints have no actuators.

    Args:
        gravity: Gravity, m/s^2.
        beside: MJCF of further objects. Feet and trunk collide with these objects, but not with each other.
        friction: Friction of all geoms.
        gains: Stiffness (N m/rad) and damping (N m s/rad) of a servo on each joint. None adds no servos.
        torques: Whether to add a motor to each joint if there are no servos.
    """
    legs = "".join(_leg(*leg) for leg in LEGS)
    trunk = '<geom name="trunk" type="box" size=".265 .115 .13" mass="21.4"/>'
    robot = f'<body name="trunk" pos="0 0 2"><freejoint/>{trunk}{legs}</body>'
    names = [f"{leg}_{part}" for leg, *_ in LEGS for part in ("hip", "thigh", "knee")]
    drive = ""
    if gains is not None:
        drive = "".join(f'<position joint="{n}" kp="{gains[0]}" kv="{gains[1]}"/>' for n in names)
    elif torques:
        drive = "".join(f'<motor joint="{n}"/>' for n in names)
    shanks = "".join(f'<exclude body1="{a}_shank" body2="{b}_shank"/>' for i, (a, *_) in enumerate(LEGS) for b, *_ in LEGS[i + 1 :])
    own = shanks + "".join(f'<exclude body1="trunk" body2="{a}_shank"/>' for a, *_ in LEGS)
    after = f"<contact>{own}</contact>" + (f"<actuator>{drive}</actuator>" if drive else "")
    return document(beside + robot, friction=friction, gravity=(0, 0, -gravity), after=after)
