"""Scenes of the golden trajectories: each has what no robot of the others' has.

Numbers that this file computes are made of sums, products and quotients alone, so that they are the same on every machine.
"""

import actuators
import numpy as np
import stepper
from equalities import KINDS, LINKAGE
from meadow import MEADOW
from models import mjcf

ROCK = "0 0 -.1  .1 .02 0  -.09 .01 .01  .01 .11 .02  0 -.1 -.02  .02 .01 .12"
SHARD = "0 0 0  .16 0 0  0 .15 0  .03 .02 .14"

SHAPES = {
    "ball": 'size=".08"',
    "pill": 'type="capsule" size=".06 .1"',
    "box": 'type="box" size=".08 .1 .06"',
    "cube": 'type="box" size=".07 .07 .07"',
    "can": 'type="cylinder" size=".07 .08"',
    "egg": 'type="ellipsoid" size=".06 .08 .1"',
    "rock": 'type="mesh" mesh="rock"',
    "shard": 'type="mesh" mesh="shard"',
}
CONDIMS = {"ball": 6, "pill": 4, "box": 3, "cube": 1, "can": 6, "egg": 4, "rock": 3, "shard": 6}

FLOOR = '<geom type="plane" size="5 5 1"/>'
PIT = """<geom type="plane" size="5 5 1"/>
  <geom type="box" size=".02 .3 .3" pos=".3 0 .3"/><geom type="box" size=".02 .3 .3" pos="-.3 0 .3"/>
  <geom type="box" size=".3 .02 .3" pos="0 .3 .3"/><geom type="box" size=".3 .02 .3" pos="0 -.3 .3"/>"""

_TURNS = ("1 0 0 0", ".9 .1 .3 0", ".7 -.2 .1 .5", ".5 .5 -.4 .1")
"""Orientations, which MuJoCo's compiler normalises."""


def loose(kinds, spacing: float = 0.19, friction: str = ".7 .02 .004") -> str:
    """Free bodies of some of the `SHAPES`, one above the other, each a little beside the one below."""
    bodies = ""
    for k, kind in enumerate(kinds):
        place = f'pos="{0.03 * (k % 3 - 1):.4g} {0.02 * (k % 4):.4g} {0.15 + spacing * k:.6g}" quat="{_TURNS[k % 4]}"'
        geom = f'<geom {SHAPES[kind]} condim="{CONDIMS[kind]}" friction="{friction}" density="{(400, 1000, 3000)[k % 3]}"/>'
        bodies += f'<body name="{kind}{k}" {place}><freejoint/>{geom}</body>'
    return bodies


def document(world: str, *, assets: str = "", after: str = "", option: str = "") -> str:
    """A model with the meshes of the `SHAPES` and a step of two milliseconds."""
    meshes = f'<mesh name="rock" vertex="{ROCK}"/><mesh name="shard" vertex="{SHARD}"/>{assets}'
    option = f'<option timestep=".002" {option}/>'
    return f"<mujoco><asset>{meshes}</asset>{option}<worldbody>{world}</worldbody>{after}</mujoco>"


PILE = document(PIT + loose(["ball", "box", "rock", "can", "pill", "cube", "egg", "shard"]))
"""One of every shape, which fall into a pit."""


def heights(rows: int = 9) -> np.ndarray:
    """Hills of up to 0.2 m: (rows, rows)."""
    i, j = np.mgrid[:rows, :rows]
    return (7 * i * i + 3 * i * j + 11 * j * j + 5 * i) % 20 / 100


def hills() -> str:
    """Every shape on a height field."""
    elevation = " ".join(f"{x:.4g}" for x in (heights() / 0.2).ravel())
    field = f'<hfield name="hills" nrow="9" ncol="9" size=".9 .9 .2 .1" elevation="{elevation}"/>'
    ground = '<geom type="hfield" hfield="hills" friction=".8 .01 .002" margin=".01" gap=".003"/>'
    bodies = "".join(
        f'<body pos="{0.4 * (k % 3 - 1):.4g} {0.45 * (k // 3 - 1):.4g} .35" quat="{_TURNS[k % 4]}"><freejoint/>'
        f'<geom {geom} condim="{CONDIMS[kind]}"/></body>'
        for k, (kind, geom) in enumerate(SHAPES.items())
    )
    return document(ground + bodies, assets=field)


def ravine() -> stepper.Model:
    """Balls, boxes and hulls on a concave mesh: its triangles collide, not their hull."""
    z = heights(6)
    points = " ".join(f"{0.25 * (i - 2.5):.6g} {0.25 * (j - 2.5):.6g} {z[i, j]:.4g}" for i in range(6) for j in range(6))
    corners = [(6 * i + j, 6 * i + j + 6, 6 * i + j + 7, 6 * i + j + 1) for i in range(5) for j in range(5)]
    faces = " ".join(f"{a} {b} {c} {a} {c} {d}" for a, b, c, d in corners)
    mesh = f'<mesh name="ground" inertia="shell" vertex="{points}" face="{faces}"/>'
    model = stepper.load(document('<geom type="mesh" mesh="ground"/>' + loose(["ball", "box", "rock", "pill", "can"], 0.25), assets=mesh))
    return model.replace(geom_concave=np.arange(model.ngeom) == 0)


def every_actuator() -> str:
    """Every kind of actuator on a joint, a slide, a tendon and a site."""
    made = [kind.format(target) for kind in actuators.KINDS.values() for target in actuators.TARGETS.values()]
    named = "".join(f'<{actuator} name="a{k}"/>' for k, actuator in enumerate(made))
    read = "".join(f'<{word} actuator="a{k}"/>' for k in range(len(made)) for word in ("actuatorpos", "actuatorvel", "actuatorfrc"))
    return actuators.TREE.format(actuators=named, sensors=read).replace(' contact="disable"', "")


def instrumented() -> stepper.Model:
    """The meadow with sensors of every kind, relative to one another, of contacts, and of many rays."""
    references = ("", 'reftype="xbody" refname="arm"', 'reftype="site" refname="ball"', 'reftype="geom" refname="pill"')
    objects = [("body", "forearm"), ("xbody", "box"), ("geom", "fist"), ("site", "hand"), ("xbody", "bob")]
    poses = ("framepos", "framequat", "framexaxis", "frameyaxis", "framezaxis", "framelinvel", "frameangvel")
    made = [
        f'<{kind} objtype="{objects[(k + i) % 5][0]}" objname="{objects[(k + i) % 5][1]}" {reference}/>'
        for i, kind in enumerate(poses)
        for k, reference in enumerate(references)
    ]
    made += [f'<{kind} objtype="{t}" objname="{name}"/>' for kind in ("framelinacc", "frameangacc") for t, name in objects]
    made += [
        f'<{kind} site="{site}"/>'
        for kind in ("magnetometer", "velocimeter", "gyro", "accelerometer", "force", "torque", "touch")
        for site in ("hand", "ball")
    ]
    made += [f'<{kind} joint="elbow"/>' for kind in ("jointpos", "jointvel", "jointactuatorfrc", "jointlimitfrc")]
    made += [f'<{kind} joint="socket"/>' for kind in ("ballquat", "ballangvel")]
    made += [f'<{kind} actuator="motor"/>' for kind in ("actuatorpos", "actuatorvel", "actuatorfrc")]
    made += [f'<{kind} geom1="ball" body2="arm" cutoff="5"/>' for kind in ("distance", "normal", "fromto")]
    made += [
        f'<contact body1="{body}" num="3" data="found force torque dist pos normal tangent" reduce="{reduction}"/>'
        for body, reduction in (("box", "none"), ("box", "mindist"), ("ball", "maxforce"), ("tin", "netforce"))
    ]
    zones = ("sphere", "capsule", "cylinder", "ellipsoid", "box")
    made += [f'<insidesite objtype="xbody" objname="{name}" site="{zone}"/>' for zone in zones for name in ("box", "egg", "ball")]
    made += [f'<touch site="{zone} feeler"/>' for zone in zones]
    made += [f'<distance geom1="floor" body2="{name}" cutoff="9"/>' for name in ("ball", "box", "pill", "tin", "egg")]
    made += ['<contact site="box" data="found force" num="2"/>', '<contact subtree1="arm" data="found dist" num="2"/>']
    made += ['<contact geom1="floor" body2="box" data="force pos" num="2" reduce="maxforce"/>']
    made += ['<clock name="clock"/>', '<insidesite objtype="xbody" objname="ball" site="hand"/>', '<jointpos name="bend" joint="elbow"/>']
    size, box = 'size=".12 .1 .15"', '<body name="box"'
    around = "".join(f'<site name="{zone}" type="{zone}" pos=".5 0 .15" {size}/>' for zone in zones)
    on_the_box = "".join(f'<site name="{zone} feeler" type="{zone}" {size}/>' for zone in zones)
    text = MEADOW.replace(box, around + box).replace('<geom name="box"', on_the_box + '<geom name="box"')
    model = stepper.load(text.replace("</sensor>", "".join(made) + "</sensor>"))
    fan = stepper.sensors.RayFan("ball", [(1, 0.1 * k, -0.5) for k in range(-3, 4)], data=("distance", "direction", "origin", "point"))
    return model.with_sensors({"fan": fan, "sum": stepper.sensors.Combination({"bend": 2.0, "clock": -0.5})})


def soft_linkage() -> stepper.Model:
    """The linkage with equalities that are springs and dampers, and two that are hard."""
    model = stepper.load(LINKAGE.format(equality=KINDS["all at once"]))
    hard = np.arange(len(model.eq_stiffness)) % 3 == 1
    return model.replace(eq_stiffness=np.where(hard, np.inf, 400.0), eq_damping=np.where(hard, 0.0, 3.0))


def gems() -> str:
    """Hulls of seventy-two corners, among themselves and on a floor of the same."""
    corners = [(i, j, k) for i in range(-5, 6) for j in range(-5, 6) for k in range(-5, 6) if i * i + j * j + k * k == 26]
    gem = f'<mesh name="gem" scale=".02 .02 .02" vertex="{" ".join(f"{i} {j} {k}" for i, j, k in corners)}"/>'
    slab = f'<mesh name="slab" scale=".2 .2 .02" vertex="{" ".join(f"{i} {j} {k}" for i, j, k in corners)}"/>'
    body = '<body pos="{:.3g} {:.3g} {:.4g}" quat="{}"><freejoint/><geom type="mesh" mesh="gem"/></body>'
    bodies = "".join(body.format(0.05 * k, 0.02 * k, 0.25 + 0.21 * k, _TURNS[k % 4]) for k in range(4))
    return document('<geom type="mesh" mesh="slab"/>' + bodies, assets=gem + slab)


def coins() -> str:
    """Cylinders that lie on one another with their ends overlapping in part, and inside one another's rim."""
    coin = '<body pos="{} 0 {}"><freejoint/><geom type="cylinder" size="{} .02"/></body>'
    places = [(0, 0.02, 0.1), (0.07, 0.06, 0.08), (0.03, 0.1, 0.1), (0.03, 0.14, 0.05)]
    return document(FLOOR + "".join(coin.format(*place) for place in places))


def marbles() -> str:
    """So many balls and boxes in a heap that pairs are searched for in cells, beside one that is too large for them."""
    ball = '<body pos="{:.4g} {:.4g} {:.4g}"><freejoint/><geom {}/></body>'
    kinds = ('size=".05"', 'type="box" size=".04 .05 .03"', 'type="capsule" size=".03 .04"')
    places = [(0.11 * (k % 4) + 0.02 * (k // 16), 0.11 * (k // 4 % 4), 0.1 + 0.12 * (k // 16)) for k in range(80)]
    small = "".join(ball.format(*place, kinds[k % 3]) for k, place in enumerate(places))
    large = '<body pos=".2 .2 1.5"><freejoint/><geom size=".6" density="20"/></body>'
    return document(FLOOR + small + large)


def shell() -> stepper.Model:
    """A concave mesh that moves: on a plane, and against other shapes."""
    z = heights(4)
    points = " ".join(f"{0.1 * (i - 1.5):.6g} {0.1 * (j - 1.5):.6g} {z[i, j]:.4g}" for i in range(4) for j in range(4)) + " 0 0 -.1"
    corners = [(4 * i + j, 4 * i + j + 4, 4 * i + j + 5, 4 * i + j + 1) for i in range(3) for j in range(3)]
    rim = [0, 1, 2, 3, 7, 11, 15, 14, 13, 12, 8, 4]
    faces = " ".join(f"{a} {b} {c} {a} {c} {d}" for a, b, c, d in corners)
    faces += "".join(f" {a} {b} 16" for a, b in zip(rim, [*rim[1:], rim[0]], strict=True))
    mesh = f'<mesh name="shell" vertex="{points}" face="{faces}"/>'
    body = '<body pos="0 0 .3"><freejoint/><geom name="shell" type="mesh" mesh="shell"/></body>'
    model = stepper.load(document(FLOOR + body + '<body pos="0 0 .7"><freejoint/><geom size=".08"/></body>', assets=mesh))
    return model.replace(geom_concave=np.array(model.geom_names) == "shell")


def sprung() -> stepper.Model:
    """The pile, in which every other geom gives way."""
    model = stepper.load(PILE)
    giving = np.arange(model.ngeom) % 2 == 1
    return model.replace(geom_stiffness=np.where(giving, 3e4, np.inf), geom_damping=np.where(giving, 60.0, 0.0))


def bouncing() -> stepper.Model:
    """Bodies that bounce, on a floor and off one another, each with a coefficient of restitution of its own."""
    model = stepper.load(document(PIT + loose(["ball", "cube", "rock", "pill", "ball"], 0.25, "0.3 0.01 0.001")))
    return model.replace(geom_restitution=np.linspace(0, 1, model.ngeom))


def elastic(count: int = 5) -> stepper.Model:
    """A row of balls that keep their energy, without friction."""
    ball = '<body pos="{0} 0 .5"><joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/><geom size=".1" condim="1"/></body>'
    world = '<geom type="plane" size="5 5 1" condim="1"/>' + "".join(ball.format(f"{0.22 * k:.4g}") for k in range(count))
    model = stepper.load(document(world))
    return model.replace(geom_restitution=np.ones(model.ngeom))


def tower() -> str:
    """Boxes whose masses grow upwards to a thousand times the lowest one's, which sweeps alone do not solve."""
    box = '<body pos="{0} 0 {1}"><freejoint/><geom type="box" size=".1 .1 .1" mass="{2}"/></body>'
    return document(FLOOR + "".join(box.format(f"{0.01 * (k % 2):.2g}", f"{0.1 + 0.2 * k:.4g}", 10**k) for k in range(4)))


BELTS = document(
    """<geom type="box" size="1 .3 .05" surfacevel=".7 .1 0 0 0 0" friction=".6 .01 .003" condim="6"/>
  <geom type="cylinder" size=".5 .05" pos="0 1 0" surfacevel="0 0 0 0 0 2" friction=".6 .01 .003" condim="4"/>
  <body pos="-.5 0 .16"><freejoint/><geom type="box" size=".1 .1 .1" friction=".6 0 0"/></body>
  <body pos="0 0 .15"><freejoint/><geom size=".1" condim="6" friction=".6 .01 .003"/></body>
  <body pos=".2 1 .15"><freejoint/><geom type="cylinder" size=".08 .1" condim="4" friction=".6 .01 .003"/></body>
  <body name="turntable" mocap="true" pos="0 -1 0"><geom name="turntable" type="box" size=".4 .4 .05"/></body>
  <body pos=".2 -1 .16"><freejoint/><geom type="box" size=".08 .1 .1" friction=".5 0 0"/></body>""",
    after='<sensor><framequat objtype="body" objname="turntable"/><framelinacc objtype="geom" objname="turntable"/></sensor>',
)
"""Surfaces that move and bodies on them: a conveyor, a turntable of a surface velocity, and one that the user turns."""

TENDONS = mjcf("tendons")
"""Springs, dampers, inertia, limits and dry friction of joints and of tendons, within a tree and between two."""

ARM = mjcf("driven_arm")
"""An arm with motors, a servo at the bounds of its force, and sensors of all kinds of readings; it meets a ball and the floor."""

SPINNING = document(
    """<body pos="0 0 1"><freejoint/><geom type="box" size=".1 .2 .03" pos=".02 0 0"/></body>
  <body pos="1 0 1"><joint type="ball"/><geom type="cylinder" size=".15 .02" pos="0 0 .2"/></body>
  <body pos="2 0 1"><joint type="ball"/><geom type="box" size=".05 .2 .1"/>
    <body pos="0 .3 0"><joint axis="1 0 1"/><geom type="ellipsoid" size=".05 .1 .15"/></body></body>""",
    option='gravity="0 0 -4"',
)
"""Bodies that tumble without contact: one afloat, a top, and two that are joined."""

FLUID = document(
    """<body pos="0 0 1" gravcomp=".7"><freejoint/><geom type="box" size=".1 .2 .05" fluidshape="ellipsoid"/>
    <body pos=".1 0 0" gravcomp="1"><joint axis="0 1 1"/><geom type="capsule" size=".03 .2" fluidshape="ellipsoid"/>
      <body pos="0 0 .3"><joint type="ball"/><geom size=".06" pos=".05 0 0"/></body></body></body>
  <body pos="1 0 1"><joint type="slide" axis="1 1 0"/><joint axis="0 0 1" pos=".1 0 0"/><geom type="box" size=".3 .01 .2"/></body>""",
    option='density="1000" viscosity=".001" wind="1 -.5 .2"',
)
"""Drag of boxes and of ellipsoids, and gravity compensation, under water."""

JAM = document(
    """<geom size=".05"/><body><joint axis="0 1 0" damping=".01"/><geom type="capsule" size=".02" fromto="0 0 0 .3 0 0"/></body>
  <body name="slot" pos="1 0 0"><geom type="box" size=".1 .1 .1" pos="0 0 .19"/><geom type="box" size=".1 .1 .1" pos="0 0 -.19"/></body>
  <body pos="1 0 0"><joint type="slide" axis="1 0 0" range="-.1 .1"/><joint type="slide" axis="0 0 1"/>
    <geom type="box" size=".1 .1 .1"/></body>"""
)
"""Overlaps that nothing can correct: a hinge within a ball, and a slider in a slot too narrow for it."""

WALL = """<mujoco><option timestep=".01" gravity="0 0 0"/><worldbody><geom type="box" size=".0005 2 2"/>
  <body pos="-.4 0 0"><freejoint/><geom size=".05"/></body><body pos="-.6 .5 0"><freejoint/><geom type="capsule" size=".02 .1"/></body>
  <body pos="-.8 -.5 0"><freejoint/><geom type="cylinder" size=".05 .1"/></body>
  <body pos="-.4 -1 0"><freejoint/><geom type="mesh" mesh="shard"/></body></worldbody>
  <asset><mesh name="shard" vertex="0 0 0  .16 0 0  0 .15 0  .03 .02 .14"/></asset></mujoco>"""
"""Bodies to be thrown at a thin wall."""

WHIRL = """<mujoco><option timestep=".02"/><worldbody><geom type="plane" size="5 5 1"/>
  <body pos="0 0 .6"><joint type="ball"/><geom type="capsule" size=".02" fromto="0 0 0 .3 0 0"/>
    <body pos=".3 0 0"><joint axis="0 1 0"/><geom type="capsule" size=".02" fromto="0 0 0 .3 0 0"/>
      <body pos=".3 0 0"><joint axis="0 0 1"/><geom type="capsule" size=".02" fromto="0 0 0 .2 0 .1"/></body></body></body>
  </worldbody></mujoco>"""
"""A chain that turns faster than its time step resolves."""
