"""Backend for UniSim, an interface to several engines (`SimBackend`), with tensors on the CPU."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepper._options import Options, Precision
from stepper._stepper import Joint, Model, Stepper
from stepper.shared.machine import require

require("unisim.contract", "for stepper.adapters.unisim")
require("torch", "for stepper.adapters.unisim")

import torch  # noqa: E402
from unisim.backend.base import (  # noqa: E402
    PublicStateWidths,
    RootStateLayout,
    SelectedResetPublication,
    TrackedBodyStateViews,
)
from unisim.contract import (  # noqa: E402
    SimBackend,
    TensorDataPlane,
    TensorExecution,
    TensorLifecycleCapabilities,
    validate_torch_device,
)
from unisim.dr.types import DomainRandomizationCapabilities  # noqa: E402

Array = NDArray[Any]


class StepperBackend(SimBackend):  # type: ignore[misc]
    """Environments of one model as a backend of UniSim: state, sensors, bodies, steps and resets of some environments.

    Tensors are float32 copies on the CPU. Bodies, joints and coordinates have MuJoCo's order and conventions. Playback, rendering and
    randomization through UniSim are not supported; use `sim.randomize`.

    Args:
        model: The model, from `stepper.load`.
        num_envs: Number of environments.
        options: Settings of the step; None selects `Options()`.
        precision: "f64" or "f32".
        threads: Number of threads; 0 uses all cores that this process may use. Results are identical bit for bit for any number.

    Attributes:
        sim: The stepper.
    """

    backend_type = "stepper"

    def __init__(self, model: Model, num_envs: int, *, options: Options | None = None, precision: Precision = "f32", threads: int = 1):
        self.sim = Stepper(model, num_envs, options=options or Options(), precision=precision, threads=threads)
        self._num_envs = num_envs
        self._free = {name: joint for joint in _free_joints(model) if (name := model.body_names[joint.bodyid])}
        self._base = 6 * len(_free_joints(model))

    @property
    def num_envs(self) -> int:
        """Number of environments."""
        return self._num_envs

    @property
    def model(self) -> Model:
        """Model of the scene."""
        return self.sim.model

    @property
    def num_actuators(self) -> int:
        """Number of actuators."""
        return self.sim.model.nu

    @property
    def num_dof_vel(self) -> int:
        """Number of velocities without those of free joints (six each)."""
        return self.sim.model.nv - self._base

    def get_public_state_widths(self) -> PublicStateWidths:
        """Sizes of qpos and qvel of one environment, nq and nv."""
        return PublicStateWidths(nq=self.sim.model.nq, nv=self.sim.model.nv)

    def get_actuator_ctrl_range(self) -> Array:
        """Lower and upper limits of the controls, (num_actuators, 2), in the units of the controls; infinite where there is no limit."""
        return np.array(self.sim.model.actuator_ctrlrange)

    def get_actuator_names(self) -> tuple[str, ...]:
        """Names of the actuators in the order of the controls."""
        return tuple(self.sim.model.actuator_names)

    def get_joint_range(self, *, names: Sequence[str] | None = None) -> Array:
        """Limits of all hinges and slides, or of the named ones, (n, 2), rad or m; infinite without limits.

        Raises:
            ValueError: A named joint is a ball or free joint.
        """
        model = self.sim.model
        every = [model.joint(k) for k in range(len(model.joint_names))] if names is None else [model.joint(name) for name in names]
        joints = [joint for joint in every if joint.nv == 1 or names is not None]
        if several := [joint.name for joint in joints if joint.nv != 1]:
            raise ValueError(f"joints {several} have more than one degree of freedom, and therefore no range")
        return np.array([joint.range if joint.limited else (-np.inf, np.inf) for joint in joints]).reshape(-1, 2)

    def get_keyframe_qpos(self, name: str) -> Array:
        """Positions of a keyframe, (nq,), m and rad.

        Raises:
            KeyError: There is no keyframe of this name.
        """
        return np.array(self.sim.model.keyframe(name).qpos)

    def get_default_qpos(self) -> Array:
        """Reference positions of the model (`qpos0`), (nq,), m and rad."""
        return np.array(self.sim.model.qpos0)

    def get_init_qvel(self) -> Array:
        """Initial velocities, (nv,), m/s and rad/s: zero."""
        return np.zeros(self.sim.model.nv)

    def get_root_state_layout(self, root_body_name: str) -> RootStateLayout:
        """Columns of qpos and qvel that belong to the free joint of a body.

        Raises:
            ValueError: The body has no free joint.
        """
        if root_body_name not in self._free:
            raise ValueError(f"body {root_body_name!r} has no free joint; bodies with one: {', '.join(self._free) or 'none'}")
        joint = self._free[root_body_name]
        return RootStateLayout(tuple(range(joint.qposadr, joint.qposadr + 7)), tuple(range(joint.dofadr, joint.dofadr + 6)))

    def get_body_ids(self, names: Sequence[str]) -> Array:
        """Indices of bodies, (n,) int32.

        Raises:
            ValueError: There is no body of a name.
        """
        known = self.sim.model.body_names
        if missing := [name for name in names if name not in known]:
            raise ValueError(f"there are no bodies {missing}; the bodies are: {', '.join(filter(None, known))}")
        return np.array([known.index(name) for name in names], dtype=np.int32)

    def get_dr_capabilities(self) -> DomainRandomizationCapabilities:
        """Kinds of domain randomization through UniSim that this backend supports: none."""
        return DomainRandomizationCapabilities()

    def get_tensor_execution(self) -> TensorExecution:
        """Device of the tensors: the CPU (`HOST_BRIDGE` in UniSim)."""
        return TensorExecution.HOST_BRIDGE

    def get_tensor_capabilities(self) -> TensorLifecycleCapabilities:
        """Features of UniSim's tensor interface that this backend supports."""
        return TensorLifecycleCapabilities(
            execution=self.get_tensor_execution(),
            state_views=True,
            state_fields=frozenset({"qpos", "qvel", "ctrl"}),
            sensor_views=True,
            stepping=True,
            selected_reset=True,
            data_plane=TensorDataPlane.HOST_BRIDGE,
            stream_event_ownership="none: all tensors are on the CPU",
            torch_devices=("cpu",),
            selected_reset_publication=SelectedResetPublication.AUTHORITATIVE_VIEWS,
            tracked_body_views=True,
            mask_selected_reset=True,
        )

    def get_state_views(self, fields: tuple[str, ...] | str | None = None, device: Any | None = None) -> Mapping[str, torch.Tensor]:
        """Copies of "qpos" (num_envs, nq), "qvel" (num_envs, nv) and "ctrl" (num_envs, num_actuators), by name; None selects all.

        Raises:
            KeyError: An unknown field.
        """
        names = ("qpos", "qvel", "ctrl") if fields is None else (fields,) if isinstance(fields, str) else tuple(fields)
        if unknown := set(names) - {"qpos", "qvel", "ctrl"}:
            raise KeyError(f"unknown fields {sorted(unknown)}; the fields are: qpos, qvel, ctrl")
        return {name: self._tensor(getattr(self.sim, name), device) for name in names}

    def get_sensor_names(self) -> tuple[str, ...]:
        """Names of all sensors that have a name."""
        return tuple(filter(None, self.sim.model.sensor_names))

    def get_sensor_view(self, name: str, device: Any | None = None) -> torch.Tensor:
        """Copy of the readings of a sensor, (num_envs, size of the reading)."""
        sensor = self.sim.model.sensor(name)
        return self._tensor(self.sim.sensordata[:, sensor.adr : sensor.adr + sensor.dim], device)

    def get_tracked_body_views(self, body_names: Sequence[str] | None = None, device: Any | None = None) -> TrackedBodyStateViews:
        """Copies of positions, quaternions, linear and angular velocities of bodies in world axes. None selects all bodies with a name."""
        names = tuple(filter(None, self.sim.model.body_names)) if body_names is None else tuple(body_names)
        ids, sim = self.get_body_ids(names), self.sim
        parts = (self._tensor(value[:, ids], device) for value in (sim.xpos, sim.xquat, sim.body_linvel, sim.body_angvel))
        return TrackedBodyStateViews(names, *parts)

    def step_tensor(self, ctrl: torch.Tensor, nsteps: int = 1) -> None:
        """Makes `nsteps` steps with the same controls, (num_envs, num_actuators) float32."""
        self._check("ctrl", ctrl, (self.num_envs, self.num_actuators), torch.float32)
        if nsteps < 1:
            raise ValueError(f"nsteps is {nsteps}, must be at least 1")
        self.sim.step(ctrl.detach().numpy(), nsteps)

    def set_state_tensor(self, env_indices: torch.Tensor, qpos: torch.Tensor, qvel: torch.Tensor, randomization: Any = None) -> None:
        """Resets the environments of `env_indices` (n,) int64 to positions (n, nq) and velocities (n, nv), float32.

        Raises:
            ValueError: A wrong shape, an index out of range or repeated, a number that is not finite, or a randomization.
            TypeError: A tensor of another type or device.
        """
        n = len(env_indices)
        self._check("env_indices", env_indices, (n,), torch.int64)
        rows = env_indices.numpy()
        if len(np.unique(rows)) != n or (rows < 0).any() or (rows >= self.num_envs).any():
            raise ValueError(f"env_indices are {rows[:10].tolist()}, must be unique and from 0 to {self.num_envs - 1}")
        self._check("qpos", qpos, (n, self.sim.model.nq), torch.float32)
        self._check("qvel", qvel, (n, self.sim.model.nv), torch.float32)
        mask = np.zeros(self.num_envs, dtype=bool)
        mask[rows] = True
        states = (np.array(self.sim.qpos, dtype=np.float64), np.array(self.sim.qvel, dtype=np.float64))
        states[0][rows], states[1][rows] = qpos.detach().numpy(), qvel.detach().numpy()
        self._reset(mask, *states, randomization)

    def set_state_tensor_mask(
        self, reset_mask: torch.Tensor, qpos: torch.Tensor, qvel: torch.Tensor, randomization: Any = None, *, full_refresh: bool = False
    ) -> None:
        """Resets the environments of the mask `reset_mask` (num_envs,) bool to given states.

        The states are positions (num_envs, nq) and velocities (num_envs, nv), float32. Rows of other environments must be finite,
        but are not used.
        """
        if full_refresh:
            raise ValueError("full_refresh is True, must be False: derived quantities are always up to date")
        self._check("reset_mask", reset_mask, (self.num_envs,), torch.bool)
        self._check("qpos", qpos, (self.num_envs, self.sim.model.nq), torch.float32)
        self._check("qvel", qvel, (self.num_envs, self.sim.model.nv), torch.float32)
        self._reset(reset_mask.numpy(), qpos.detach().numpy().astype(np.float64), qvel.detach().numpy().astype(np.float64), randomization)

    def _host_reset(self, env_ids: Array | None = None) -> None:
        self._host_reset_default(env_ids)

    def _host_get_state(self, fields: tuple[str, ...] | str | None = None) -> Mapping[str, Array]:
        return {name: value.numpy() for name, value in self.get_state_views(fields).items()}

    def _host_set_state(self, env_indices: Array, qpos: Array, qvel: Array, randomization: Any = None) -> None:
        position, velocity = (torch.from_numpy(np.ascontiguousarray(value, dtype=np.float32)) for value in (qpos, qvel))
        self.set_state_tensor(torch.from_numpy(np.asarray(env_indices, dtype=np.int64)), position, velocity, randomization)

    def _reset(self, mask: Array, qpos: Array, qvel: Array, randomization: Any) -> None:
        """Resets the environments of a mask (num_envs,) to given positions (num_envs, nq) and velocities (num_envs, nv), in float64.

        Raises:
            ValueError: `randomization` is not empty, which this backend does not support.
        """
        if randomization is not None and not randomization.is_empty():
            raise ValueError("randomization is given, must be None: use sim.randomize")
        if mask.any():
            self.sim.reset(mask, qpos=qpos, qvel=qvel)

    def _tensor(self, value: Array, device: Any) -> torch.Tensor:
        """Copy of an array as a float32 tensor on the CPU; UniSim's check raises an error for any other `device`."""
        validate_torch_device(("cpu",), torch.device("cpu" if device is None else device), label="stepper")
        return torch.from_numpy(np.array(value, dtype=np.float32))

    @staticmethod
    def _check(name: str, value: Any, shape: tuple[int, ...], dtype: torch.dtype) -> None:
        """Raises an error if a tensor has another type, device or shape, or numbers that are not finite; `name` is for the message."""
        if not isinstance(value, torch.Tensor) or value.dtype != dtype or value.device.type != "cpu":
            raise TypeError(f"{name} is {getattr(value, 'dtype', type(value).__name__)}, must be a {dtype} tensor on the CPU")
        if tuple(value.shape) != shape or not value.is_contiguous():
            raise ValueError(f"{name} has shape {tuple(value.shape)}, must be contiguous and have {shape}")
        if not bool(torch.isfinite(value).all()):
            raise ValueError(f"{name} has numbers that are not finite")


def _free_joints(model: Model) -> list[Joint]:
    """All free joints of a model."""
    return [joint for joint in map(model.joint, range(len(model.joint_names))) if joint.type == "free"]
