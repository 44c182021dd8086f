"""Scenes for the tests of loading: small URDFs and meshes."""

INERTIAL = '<inertial><mass value="{mass}"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
LIMIT = '<limit lower="-1" upper="2" effort="10" velocity="3"/>'


def sphere(radius: float, x: float = 0.0) -> str:
    """A collision element."""
    return f'<collision><origin xyz="{x} 0 0"/><geometry><sphere radius="{radius}"/></geometry></collision>'


def link(name: str, more: str = "", mass: float = 1.0) -> str:
    """A link with a mass and whatever else it has."""
    return f'<link name="{name}">{INERTIAL.format(mass=mass)}{more}</link>'


def joint(name: str, parent: str, child: str, *, kind: str = "revolute", x: float = 0.0, more: str = "") -> str:
    """A joint about z."""
    ends = f'<parent link="{parent}"/><child link="{child}"/>'
    return f'<joint name="{name}" type="{kind}"><origin xyz="{x} 0 0"/>{ends}<axis xyz="0 0 1"/>{more}</joint>'


def robot(*parts: str) -> str:
    """A URDF."""
    return f'<robot name="r">{"".join(parts)}</robot>'


def arm(base: str = "", upper: str = "", lower: str = "", top: str = "") -> str:
    """A base on the world, an upper arm 1 m from it and a lower arm 1 m farther out, with more in links, and more elements at the top."""
    links = link("base", base, mass=10), link("upper", upper), link("lower", lower)
    return robot(*links, joint("shoulder", "base", "upper", x=1, more=LIMIT), joint("elbow", "upper", "lower", x=1, more=LIMIT), top)


def sheet(heights: list[list[float]], cell: float = 1.0) -> tuple[str, str]:
    """Vertices and faces, in MJCF's words, of a surface over a grid in the middle of the world, seen from above."""
    rows, columns = len(heights), len(heights[0])
    at = [(cell * (j - (columns - 1) / 2), cell * (i - (rows - 1) / 2), heights[i][j]) for i in range(rows) for j in range(columns)]
    cells = [i * columns + j for i in range(rows - 1) for j in range(columns - 1)]
    faces = [f"{a} {a + 1} {a + columns}  {a + 1} {a + columns + 1} {a + columns}" for a in cells]
    return "  ".join(f"{x} {y} {z}" for x, y, z in at), "  ".join(faces)
