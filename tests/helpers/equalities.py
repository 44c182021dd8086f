"""A linkage with equalities of every kind, and their rows in NumPy from MuJoCo's Jacobians: error, Jacobian and curvature J' v."""

from dataclasses import dataclass

import mujoco
import numpy as np

LINKAGE = """<mujoco><default><geom contype="0" conaffinity="0" density="300"/></default><worldbody>
  <site name="wall" pos=".1 .2 .9" euler="20 30 40"/>
  <body name="hand" mocap="true" pos=".3 .1 .8" euler="10 0 50"/>
  <body name="a" pos="0 0 1"><joint name="a1" axis="0 1 .2" ref=".3"/><joint name="a2" type="slide" axis="1 0 0"/>
    <geom type="capsule" size=".03" fromto="0 0 0 .3 0 0"/><site name="sa" pos=".3 .02 0" euler="5 6 7"/>
    <body name="b" pos=".3 0 0"><joint name="b1" type="ball" armature=".01"/><geom type="box" size=".1 .05 .03" pos=".1 0 0"/>
      <site name="sb" pos=".2 0 .01" euler="50 0 0"/>
      
        <body name="c" pos=".2 0 0"><joint name="c1" axis="0 0 1"/><geom type="capsule" size=".02" fromto="0 0 0 0 .2 0"/>
        </body></body></body>
  <body name="d" pos="1 0 1"><freejoint/><geom type="box" size=".1 .2 .05"/><site name="sd" pos=".1 0 0" euler="0 20 0"/></body>
  <body name="e" pos="-1 0 1"><joint name="e1" axis="0 1 0"/><geom type="capsule" size=".03" fromto="0 0 0 0 0 .3"/>
    <body name="f" pos="0 0 .3"><joint name="f1" axis="0 1 0"/><geom type="capsule" size=".03" fromto="0 0 0 0 0 .3"/></body></body>
  </worldbody>
  <tendon><fixed name="t1"><joint joint="e1" coef="1.5"/><joint joint="f1" coef="-.5"/></fixed>
    <fixed name="t2"><joint joint="c1" coef="1"/><joint joint="a1" coef=".7"/></fixed></tendon>
  <equality>{equality}</equality></mujoco>"""

KINDS = {
    "connect to the world": '<connect body1="c" body2="world" anchor="0 .2 0"/>',
    "connect from the world": '<connect body1="world" body2="c" anchor=".4 0 1"/>',
    "connect in a tree": '<connect body1="c" body2="a" anchor="0 .2 .1"/>',
    "connect of trees": '<connect body1="c" body2="d" anchor=".1 0 .2"/>',
    "connect of sites": '<connect site1="sb" site2="sd"/>',
    "weld": '<weld body1="b" body2="d"/>',
    "weld with a pose and a scale": '<weld body1="d" body2="f" anchor=".1 0 .1" relpose="1 .1 .2 .7 .1 .1 .7" torquescale=".3"/>',
    "weld without torque": '<weld body1="d" body2="world" torquescale="0"/>',
    "weld of sites": '<weld site1="sd" site2="wall"/>',
    "weld to a mocap body": '<weld body1="d" body2="hand"/>',
    "joint to joint": '<joint joint1="a1" joint2="e1" polycoef=".1 .8 -.3 .2 .1"/>',
    "joint": '<joint joint1="a1" polycoef=".2 0 0 0 0"/>',
    "tendon to tendon": '<tendon tendon1="t1" tendon2="t2" polycoef="0 1 .5 0 .2"/>',
    "tendon": '<tendon tendon1="t1" polycoef=".1 0 0 0 0"/>',
    "all at once": '<connect body1="c" body2="d" anchor=".1 0 .2"/><weld body1="f" body2="d"/><joint joint1="a2" joint2="c1"/>'
    '<tendon tendon1="t1"/>',
    "twice the same": '<connect body1="c" body2="d" anchor=".1 0 .2"/><joint joint1="a1" joint2="e1"/>'
    '<connect body1="c" body2="d" anchor=".1 0 .2"/>',
}


@dataclass
class Rows:
    """Error (n,), Jacobian (n, nv), rate of the Jacobian times the velocity (n,), and which equality each row is of."""

    error: np.ndarray
    jacobian: np.ndarray
    curvature: np.ndarray
    owner: np.ndarray

    def correction(self, options, h: float, *, midpoint: bool) -> np.ndarray:
        """Velocities that take a part of the errors away, those of a point or of a turn capped together."""
        error = self.error - (h * h / 8 * self.curvature if midpoint else 0)
        out = np.zeros(len(error))
        for i in np.unique(self.owner):
            mine = np.flatnonzero(self.owner == i)
            for part in np.array_split(mine, max(1, len(mine) // 3)):
                length = np.linalg.norm(error[part])
                out[part] = min(options.baumgarte / h, options.max_correction_speed / max(length, 1e-300)) * error[part]
        return out


def rows_of(model: mujoco.MjModel, data: mujoco.MjData) -> Rows:
    """All active equalities at a state whose positions and velocities are computed."""
    parts = [(i, _rows(model, data, i)) for i in np.flatnonzero(model.eq_active0)]
    owner = np.concatenate([np.full(len(rows[0]), i) for i, rows in parts])
    error, jacobian, curvature = (np.concatenate([rows[k] for _, rows in parts]) for k in range(3))
    return Rows(error, jacobian, curvature, owner)


def _rows(model, data, i):
    kind = mujoco.mjtEq(int(model.eq_type[i]))
    if kind in (mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD):
        return _points(model, data, i, weld=kind == mujoco.mjtEq.mjEQ_WELD)
    return _coupling(model, data, i, tendon=kind == mujoco.mjtEq.mjEQ_TENDON)


def _points(model, data, i, *, weld):
    bodies, points, turns = _sides(model, data, i, weld)
    jacobians = [np.zeros((2, 3, model.nv)) for _ in range(2)]
    rates = [np.zeros((2, 3, model.nv)) for _ in range(2)]
    for body, point, jac, rate in zip(bodies, points, jacobians, rates, strict=True):
        mujoco.mj_jac(model, data, jac[0], jac[1], point, body)
        mujoco.mj_jacDot(model, data, rate[0], rate[1], point, body)
    jacobian, rate = jacobians[0] - jacobians[1], rates[0] - rates[1]
    # Joints that move both bodies turn the error of a point and keep its length.
    jacobian[0][:, _moves(model, bodies[0]) & _moves(model, bodies[1])] = 0
    error, parts = [points[0] - points[1]], 1
    if weld:
        scale, parts = model.eq_data[i, 10], 2
        back, turn, vector = np.zeros(4), np.zeros(4), np.zeros(3)
        mujoco.mju_negQuat(back, turns[1])
        mujoco.mju_mulQuat(turn, turns[0], back)
        mujoco.mju_quat2Vel(vector, turn, 1)
        error.append(scale * vector)
        jacobian[1] *= scale
        rate[1] *= scale
    nv = model.nv
    return np.concatenate(error), jacobian[:parts].reshape(-1, nv), rate[:parts].reshape(-1, nv) @ data.qvel


def _moves(model, body):
    """Which degrees of freedom move a body, (nv,)."""
    moves = np.zeros(model.nv, bool)
    while body:
        moves |= model.dof_bodyid == body
        body = model.body_parentid[body]
    return moves


def _sides(model, data, i, weld):
    objects, numbers = [model.eq_obj1id[i], model.eq_obj2id[i]], model.eq_data[i]
    if mujoco.mjtObj(int(model.eq_objtype[i])) == mujoco.mjtObj.mjOBJ_SITE:
        turns = [np.zeros(4) for _ in range(2)]
        for turn, site in zip(turns, objects, strict=True):
            mujoco.mju_mat2Quat(turn, data.site_xmat[site])
        return model.site_bodyid[objects], data.site_xpos[objects], turns
    anchors = [numbers[3:6], numbers[:3]] if weld else [numbers[:3], numbers[3:6]]
    points = [data.xpos[b] + data.xmat[b].reshape(3, 3) @ a for b, a in zip(objects, anchors, strict=True)]
    first = np.zeros(4)
    mujoco.mju_mulQuat(first, data.xquat[objects[0]], numbers[6:10])
    return objects, points, [first, data.xquat[objects[1]]]


def _coupling(model, data, i, *, tendon):
    polynomial = np.polynomial.Polynomial(model.eq_data[i, :5])
    (x, j), other = _scalar(model, data, model.eq_obj1id[i], tendon), model.eq_obj2id[i]
    if other < 0:
        return np.array([x - polynomial(0)]), j[None], np.zeros(1)
    y, k = _scalar(model, data, other, tendon)
    slope, bend = polynomial.deriv()(y), polynomial.deriv(2)(y)
    return np.array([x - polynomial(y)]), (j - slope * k)[None], np.array([-bend * (k @ data.qvel) ** 2])


def _scalar(model, data, index, tendon):
    """Distance from the reference, and the row of the Jacobian."""
    row = np.zeros(model.nv)
    if not tendon:
        row[model.jnt_dofadr[index]] = 1
        at = model.jnt_qposadr[index]
        return data.qpos[at] - model.qpos0[at], row
    for k in range(model.tendon_adr[index], model.tendon_adr[index] + model.tendon_num[index]):
        row[model.jnt_dofadr[model.wrap_objid[k]]] += model.wrap_prm[k]
    return data.ten_length[index] - model.tendon_length0[index], row
