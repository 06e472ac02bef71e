"""Task as an rsl_rl `VecEnv`: actions in, observation groups and rewards out, in torch, on the device of the robots."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from rsl_rl.env import VecEnv
from tensordict import TensorDict

from stiction.files.known_friction import kind_average
from stiction.joints.compensation import BY_SPEED, compensated
from stiction.joints.net import ActuatorNet
from stiction.robots.catalog import find_robot
from stiction.robots.model import Robot
from stiction.sim.fleet import Fleet
from stiction.sim.indexing import assign
from stiction.task.config import CommandCfg, TaskCfg
from stiction.task.events import INTERVALS, RESET, ended
from stiction.task.observations import ESTIMATED, FRAME_TERMS, FrameBuilder, History, SlowMeans, gait_phase
from stiction.task.randomization import Randomizer, friction_angle, nominal_joints
from stiction.task.rewards import TASK, Snapshot
from stiction.task.task_fleet import CPU, Device, HostFleet, NetMotors, TaskFleet, to_tensor
from stiction.task.terrain import SCAN_POINTS, UNDER_TRUNK, Curriculum

UNSYNC_HORIZON = 100
"""H of r_unsync in control steps (2 s at 50 Hz)."""


def exactly_one_group(contact: torch.Tensor, group: torch.Tensor) -> torch.Tensor:
    """Return r_trot, (N,) bool: the feet in contact, (N, legs), are exactly one of the groups, (legs,) 0 or 1."""
    first = group == 0
    return (contact == first).all(-1) | (contact == ~first).all(-1)


def group_imbalance(contact: torch.Tensor, group: torch.Tensor) -> torch.Tensor:
    """Return |C_0 ∩ C_t| - |C_1 ∩ C_t|, one step's summand of r_unsync, shape (N,). Arguments as above."""
    sign = 1.0 - 2.0 * group.to(torch.float32)
    return contact.to(torch.float32) @ sign


class UnsyncWindow:
    """Running sum of the imbalance over the last `horizon` steps: |sum| is r_unsync."""

    def __init__(
        self, num_envs: int, legs: int, horizon: int = UNSYNC_HORIZON, task_device: torch.device | None = None
    ) -> None:
        """Start with an empty window, on `task_device`."""
        self.window = torch.zeros(horizon, num_envs, device=task_device)
        self.cursor = 0
        self.largest = horizon * (legs / 2)

    def push(self, imbalance: torch.Tensor) -> torch.Tensor:
        """Add one step's imbalance, shape (N,); return r_unsync as a share of its largest value, shape (N,)."""
        self.window[self.cursor] = imbalance
        self.cursor = (self.cursor + 1) % len(self.window)
        return self.window.sum(0).abs() / self.largest

    def reset(self, which: torch.Tensor) -> None:
        """Clear the window of the robots `which`, see `sim.indexing`."""
        assign(self.window.T, which, 0.0)


RATIO_FROM = 0.3
"""Minimum commanded speed for the figures of speed over command [m/s]."""

ELEVATION_SCALE = 0.2
"""Unit of the elevation map [m]."""

_BUFFERS = (
    *("episode_length_buf", "last_action", "last_velocity", "air_time", "measured_position", "measured_velocity"),
    *("bench_error", "first_side"),
)
"""Per-robot buffers in a checkpoint, in addition to the simulation."""


class CommandSampler:
    """Command of every robot: vx, vy [m/s] and yaw rate [rad/s] in the base frame."""

    def __init__(self, cfg: CommandCfg, num_envs: int, task_device: torch.device | None = None) -> None:
        """Start with every robot commanded to stand, on `task_device`."""
        self.cfg = cfg
        self.value = torch.zeros(num_envs, 3, device=task_device)
        spans = torch.tensor([cfg.forward, cfg.sideways, cfg.turn], device=task_device)
        self._low, self._width = spans[:, 0], spans[:, 1] - spans[:, 0]

    @property
    def moving(self) -> torch.Tensor:
        """True for robots commanded to move, (N,) bool."""
        return self.value.norm(dim=-1) > self.cfg.moving_above

    def override(self, mask: torch.Tensor, value: torch.Tensor) -> None:
        """Set the command of the robots in `mask`, (N,) bool, to `value`, (N, 3). The tensor is replaced."""
        self.value = torch.where(mask[:, None], value, self.value)

    def draw(self, which: torch.Tensor, generator: torch.Generator) -> None:
        """Draw commands for the robots `which`, see `sim.indexing`. Replaces the tensor: observations keep theirs."""
        if not len(which):
            return
        num, task_device = len(which), self.value.device
        new = self._low + self._width * torch.rand(num, 3, generator=generator, device=task_device)
        standing = torch.rand(num, 1, generator=generator, device=task_device) < self.cfg.standing_share
        small = new.norm(dim=-1, keepdim=True) <= self.cfg.moving_above
        value = self.value.clone()
        assign(value, which, torch.where(standing | small, 0.0, new))
        self.value = value


class LocomotionEnv(VecEnv):
    """Velocity tracking for any legged robot.

    Observation groups, float32 and new tensors at every step: `proprioception` (o_prio), `history` (o_H, flattened,
    oldest frame first), `privileged` (o_priv), `explicit` (o_exp, see `ESTIMATED`), and except on flat ground
    `elevation` (e_t: depth of the ground below the standing height, in units of 0.2 m).
    """

    def __init__(
        self,
        cfg: TaskCfg,
        num_envs: int,
        seed: int,
        threads: int = 1,
        identified: dict[str, np.ndarray] | None = None,
        device: Device = CPU,
        actuator: ActuatorNet | None = None,
        spec: Robot | None = None,
    ) -> None:
        """Build the fleet and reset every robot.

        `identified`: see `nominal_joints`; `actuator`: net that replaces the PD law; `spec`: robot that replaces that
        in `cfg`. Raises `StictionError` where the net does not match robot, physics step or friction.
        """
        self.cfg: Any = cfg
        self.num_envs, self.device = num_envs, device.torch
        self.spec = find_robot(cfg.robot) if spec is None else spec
        self.num_actions = self.spec.num_joints
        flat, draws = cfg.terrain.kind == "flat", np.random.default_rng(seed)
        self.course = None if flat else Curriculum(cfg.terrain, num_envs, draws)
        self.robots = self._make_robots(device, threads, actuator)
        self.task_device = task_device = self.robots.task_device
        self.by_mask = task_device.type == "cuda"
        """True if robots are selected by mask, see `sim.indexing`: random numbers are then drawn for all of them."""
        self.generator = torch.Generator(task_device).manual_seed(seed)
        nominal = nominal_joints(self.robots, cfg.friction, identified)
        self.randomizer = Randomizer(self.robots, cfg.randomization, cfg.friction, nominal)
        extra = friction_angle(cfg.friction, nominal, self.spec)
        self.compensation = None if extra is None else torch.tensor(extra, device=task_device)
        self.stage = 0
        self.return_terminal_obs = False
        """True to add, in a step with time-outs, `extras["terminal"]`, (N, frame): the observations without the reset,
        which `_observe` does not have."""
        self.commands = CommandSampler(cfg.commands, num_envs, task_device)
        self.layout = cfg.layout(self.spec)
        self.standing = torch.from_numpy(self.robots.standing).float().to(task_device)
        scale = self.spec.action_scale
        self.action_scale = scale if isinstance(scale, float) else torch.from_numpy(scale).float().to(task_device)
        self.torque_limit = torch.from_numpy(self.robots.torque_limit).float().to(task_device)
        groups = self.spec.groups()
        self.group = None if groups is None else torch.from_numpy(groups).to(task_device)
        self.foot_phases = torch.from_numpy(self.spec.foot_phases).float().to(task_device)
        self.sideways = torch.tensor(self.spec.sideways_joints, device=task_device)
        self.frames = FrameBuilder(self.layout, self.standing)
        self.history = History(num_envs, self.layout, task_device)
        decay = self.layout.slow_kept
        self.slow = None if decay is None else SlowMeans(num_envs, self.num_actions, decay, task_device)
        self.unsync = UnsyncWindow(num_envs, len(self.spec.feet), task_device=task_device)
        self.terms = cfg.rewards.terms_for(self.spec)
        self.max_episode_length = round(cfg.episode / cfg.control_period)
        self.intervals = [(event, round(every(cfg) / cfg.control_period)) for event, every in INTERVALS]
        """Events within an episode, and the control periods between two of them; 0: never."""
        self.episode_length_buf = torch.zeros(num_envs, dtype=torch.long, device=task_device)
        self.last_action = torch.zeros(num_envs, self.num_actions, device=task_device)
        self.last_velocity = torch.zeros(num_envs, self.num_actions, device=task_device)
        self.air_time = torch.zeros(num_envs, len(self.spec.feet), device=task_device)
        kinds = [joint.kind for joint in self.spec.joints]
        self.kind_average = torch.from_numpy(kind_average(kinds)).float().to(task_device)
        self.bench_error = torch.ones(num_envs, self.kind_average.shape[1], device=task_device)
        self.first_side = torch.ones(num_envs, 1, device=task_device)
        all_robots = torch.ones(num_envs, dtype=torch.bool, device=task_device)
        self._reset(self._which(all_robots))
        self._observation = self._observe(all_robots)

    def _make_robots(self, device: Device, threads: int, actuator: ActuatorNet | None) -> TaskFleet:
        """Build the fleet: on the device if it has one, else on the host."""
        cfg, num = self.cfg, self.num_envs
        steps = (cfg.timestep, cfg.decimation)
        if device.fleet is not None:
            return device.fleet(self.spec, num, *steps, cfg.physics)
        terrain, sensors = self.course.terrain if self.course else None, cfg.friction.loaded
        fleet = Fleet(self.spec, num, *steps, threads, device.backend, terrain, sensors, cfg.physics)
        if actuator is not None:
            cfg.check_net(actuator, self.spec)
        return HostFleet(fleet, cfg.friction.laws, None if actuator is None else NetMotors(fleet, actuator))

    @property
    def host(self) -> HostFleet:
        """Robots on the host. Raises `TypeError` where they are on a device."""
        if not isinstance(self.robots, HostFleet):
            raise TypeError(f"the robots are on {self.task_device}, and this needs them on the host")
        return self.robots

    @property
    def fleet(self) -> Fleet:
        """NumPy fleet of robots on the host."""
        return self.host.fleet

    @property
    def motors(self) -> NetMotors | None:
        """Motors that replace the PD law."""
        return self.robots.motors if isinstance(self.robots, HostFleet) else None

    def _which(self, mask: torch.Tensor) -> torch.Tensor:
        """Return the robots of a mask, (N,) bool, as ids or a mask."""
        return mask if self.by_mask else mask.nonzero().flatten()

    def uniform(self, *size: int) -> torch.Tensor:
        """Draw numbers in [-1, 1), of shape `size`."""
        return 2 * torch.rand(*size, generator=self.generator, device=self.task_device) - 1

    def get_observations(self) -> TensorDict:
        """Return the current observations."""
        return self._observation

    def step(self, actions: torch.Tensor) -> tuple[TensorDict, torch.Tensor, torch.Tensor, dict]:
        """Apply actions, (N, joints), for one control period; reset robots that fell, blew up or timed out."""
        actions = actions.to(self.task_device).clamp(-self.cfg.action_clip, self.cfg.action_clip)
        targets = self.standing + self.action_scale * actions
        if self.compensation is not None:
            measured = self.measured_position, self.measured_velocity
            targets = compensated(targets, *measured, self.compensation, BY_SPEED.push)
        # The controller holds the angle that it measures, which is the true one and the encoder's error.
        self.robots.set_targets(targets - self.randomizer.draws.encoder_offset)
        blown_up = self.robots.step()
        # Not in place: the trainer still holds the ages of before the step.
        self.episode_length_buf = self.episode_length_buf + 1

        snapshot = self._snapshot(actions, blown_up)
        reward, task = (torch.zeros(self.num_envs, device=self.task_device) for _ in range(2))
        means = {}
        for name, (term, weight) in self.terms.items():
            value = weight * term(snapshot)
            reward += value
            if name in TASK:
                task += value
            means[f"reward/{name}"] = value.mean()
        # The fleet has reset a robot that blew up: its state says nothing of the step.
        reward, task = (torch.where(blown_up, 0.0, paid * self.cfg.control_period) for paid in (reward, task))
        self.last_action = actions

        fallen = ended(self, snapshot, fails=True)
        if self.course:
            self.course.walk(self.fleet.qvel[:, :2], self.cfg.control_period)
            left = (self.max_episode_length - self.episode_length_buf) * self.cfg.control_period
            self.course.fall(fallen.numpy(), left.numpy())
        time_outs = ended(self, snapshot, fails=False) & ~fallen
        dones = fallen | time_outs
        log = means | self._log(snapshot, fallen, blown_up)
        if self.course:
            log |= {name: torch.tensor(value) for name, value in self.course.figures().items()}
        extras: dict[str, Any] = {"time_outs": time_outs.float().to(self.device), "log": log}
        # What of the reward the task has paid, (N,).
        extras["task"] = task.to(self.device)
        if self.return_terminal_obs and time_outs.any():
            # Before the reset, for after it these states are gone.
            extras["terminal"] = self._frame_without_reset().to(self.device)
        self._reset(self._which(dones))
        self._trigger_events(dones)
        self._observation = self._observe(dones)
        return self._observation, reward.to(self.device), dones.to(self.device), extras

    def enter_stage(self, number: int) -> None:
        """Enter a stage of the friction's schedule."""
        self.stage = number
        self.randomizer.enter(self.cfg.friction.schedule[number].mixture, self.generator)

    def _snapshot(self, actions: torch.Tensor, blown_up: torch.Tensor) -> Snapshot:
        """Collect the inputs of the rewards."""
        fleet, task_device = self.robots, self.task_device
        velocity = fleet.joint_velocity
        acceleration = (velocity - self.last_velocity) / self.cfg.control_period
        self.last_velocity = velocity
        contact = fleet.foot_contact
        landed = torch.where(contact, self.air_time, 0.0)
        self.air_time = torch.where(contact, 0.0, self.air_time + self.cfg.control_period)
        self.linear_velocity = fleet.base_linear_velocity
        self.contact = contact
        deviation = fleet.joint_position - self.standing
        quaternion = fleet.base_quaternion
        w, x, y, z = quaternion.unbind(-1)
        if self.group is None:
            one_group = torch.zeros(self.num_envs, dtype=torch.bool, device=task_device)
            unsync = torch.zeros(self.num_envs, device=task_device)
        else:
            one_group = exactly_one_group(contact, self.group)
            unsync = self.unsync.push(group_imbalance(contact, self.group))
        command, rates = self.commands.value, fleet.base_angular_velocity
        return Snapshot(
            command=command,
            moving=self.commands.moving,
            linear_velocity=self.linear_velocity,
            angular_velocity=rates,
            up=torch.stack((2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)), -1),
            height_error=fleet.height - self.spec.standing_height,
            torque_share=fleet.torque / self.torque_limit,
            joint_deviation=deviation,
            sideways_deviation=deviation[:, self.sideways],
            joint_acceleration=acceleration,
            action_change=actions - self.last_action,
            contact=contact,
            one_group=one_group,
            unsync=unsync,
            in_stance=torch.zeros_like(contact) if self.layout.clock is None else gait_phase(self).sin() >= 0.0,
            landed_air_time=landed,
            fallen=fleet.fallen() & ~blown_up,
            blown_up=blown_up,
        )

    def _log(self, snapshot: Snapshot, fallen: torch.Tensor, blown_up: torch.Tensor) -> dict[str, torch.Tensor]:
        """Return the figures of the walk in this step, scalars."""
        moving = snapshot.moving.float()
        error = (snapshot.command[:, :2] - snapshot.linear_velocity[:, :2]).norm(dim=-1)
        log = {
            "walk/tracking_error": error.mean(),
            "walk/falls": fallen.float().mean() / self.cfg.control_period,
            "walk/blown_up": blown_up.sum().float(),
        }
        if self.group is not None:
            log["walk/tripod_share"] = (snapshot.one_group * moving).sum() / moving.sum().clamp(min=1.0)
        command = snapshot.command[:, 0]
        # Infinite at a command of zero, which neither of the masks lets through.
        ratio = snapshot.linear_velocity[:, 0] / command
        backward, forward = self.cfg.commands.forward
        for name, sign, commanded in (("forward", 1.0, forward), ("backward", -1.0, -backward)):
            # Where nobody is asked to go there is no ratio: one of 0 would say that they do not walk.
            if commanded > RATIO_FROM:
                mask = sign * command > RATIO_FROM
                log[f"walk/{name}_ratio"] = torch.where(mask, ratio, 0.0).sum() / mask.sum().clamp(min=1)
        if any(law.spec.reads for law in self.cfg.friction.laws):
            log["friction/share"] = torch.as_tensor((self.fleet.friction / self.fleet.torque_limit).mean())
        return log

    def _reset(self, which: torch.Tensor) -> None:
        """Start new episodes with newly drawn robots."""
        if not len(which):
            return
        for event in RESET:
            event(self, which)

    def _trigger_events(self, fresh: torch.Tensor) -> None:
        """Trigger events for robots whose interval is over, except those that are `fresh`, (N,) bool."""
        for event, interval in self.intervals:
            if interval:
                event(self, self._which((self.episode_length_buf % interval == 0) & ~fresh))

    def _observe(self, fresh: torch.Tensor) -> TensorDict:
        """Build every observation group from the state after resets and pushes."""
        elevation = self._elevation_group() if self.course else {}
        frame = self._frame(fresh)
        groups = {
            "proprioception": frame,
            "history": self.history.push(frame, fresh),
            "privileged": self.randomizer.privileged(),
            "explicit": torch.cat([term(self) for term, is_estimated in ESTIMATED if is_estimated(self.cfg)], -1),
            **elevation,
        }
        return self._to_networks(groups)

    def _frame(self, fresh: torch.Tensor) -> torch.Tensor:
        """Measure, with noise, and return one frame of every robot, (N, frame_size); `fresh`: as of `History.push`."""
        raw = {}
        for name in (term.name for term in self.layout.terms):
            if name in FRAME_TERMS:
                value, noise = FRAME_TERMS[name](self), getattr(self.cfg.noise, name, None)
                raw[name] = value if noise is None else value + noise * self.uniform(*value.shape)
        self.measured_position, self.measured_velocity = raw["joint_position"], raw["joint_velocity"]
        if self.slow is not None:
            error = self.standing + self.action_scale * self.last_action - self.measured_position
            raw |= self.slow.push(error, raw["joint_velocity"], fresh)
        return self.frames(raw)

    def _frame_without_reset(self) -> torch.Tensor:
        """Return the next frame of every robot as without a reset, (N, frame_size)."""
        # `push` puts new tensors in their places, so that these stay what they are.
        state = None if self.slow is None else (self.slow.sums, self.slow.weight)
        frame = self._frame(torch.zeros(self.num_envs, dtype=torch.bool, device=self.task_device))
        if self.slow is not None and state is not None:
            self.slow.sums, self.slow.weight = state
        return frame

    def _to_networks(self, groups: dict[str, torch.Tensor]) -> TensorDict:
        """Return observation groups on the device of the networks."""
        return TensorDict({name: value.to(self.device) for name, value in groups.items()}, batch_size=[self.num_envs])

    def _elevation_group(self) -> dict[str, torch.Tensor]:
        """Hold the robots on their courses, compute the ground under them, and return the elevation map as a group."""
        assert self.course is not None
        fleet = self.fleet
        on_course = torch.from_numpy(self.course.on_course)
        self.commands.override(on_course, to_tensor(self.course.command(fleet.yaw)))
        scan = fleet.ground_around(SCAN_POINTS)
        fleet.ground[:] = scan[:, UNDER_TRUNK].mean(-1)
        below = to_tensor(fleet.base_position[:, 2:3] - self.spec.standing_height - scan)
        noise = self.uniform(*below.shape)
        return {"elevation": ((below + self.cfg.terrain.elevation_noise * noise) / ELEVATION_SCALE).clamp(-5.0, 5.0)}

    def state(self) -> dict[str, Any]:
        """Return the complete state of the next step, for a checkpoint."""
        host = self.robots if isinstance(self.robots, HostFleet) else None
        friction = {} if host is None else host.law.state()
        return ({"friction": friction} if friction else {}) | {
            "simulation": self.robots.state(),
            "draws": dict(vars(self.randomizer.draws)),
            "buffers": {name: getattr(self, name) for name in _BUFFERS},
            "command": self.commands.value,
            "history": self.history.frames,
            "slow": {} if self.slow is None else {"sums": self.slow.sums, "weight": self.slow.weight},
            "unsync": {"window": self.unsync.window, "cursor": self.unsync.cursor},
            "observation": dict(self._observation.items()),
            "generator": self.generator.get_state(),
            "blown_up": self.robots.blown_up,
            "stage": self.stage,
            "course": self.course.state() if self.course else None,
            "ground": torch.zeros(self.num_envs) if host is None else host.fleet.ground,
            "motors": {} if self.motors is None else self.motors.state() | {"targets": self.fleet.targets.copy()},
        }

    def load_state(self, state: dict[str, Any]) -> None:
        """Restore a `state`; the next step is then bit-identical on the same number of threads."""
        # Older states are without schedules, terrain and Actuator Nets.
        state = {"stage": 0, "course": None, "ground": torch.zeros(self.num_envs), "motors": {}} | state
        for name, value in state["draws"].items():
            setattr(self.randomizer.draws, name, self._own(value))
        self.stage = state["stage"]
        self.randomizer.mixture = self.cfg.friction.schedule[self.stage].mixture
        # Before the rest: it forgets the friction of the last step, which `_load_host` brings back.
        self.randomizer.apply(torch.arange(self.num_envs, device=self.task_device))
        if self.course:
            self.course.load_state(state["course"])
            self.fleet.show_terrain(np.arange(self.num_envs))
        self.robots.load_state(state["simulation"])
        if isinstance(self.robots, HostFleet):
            self._load_host(state)
        else:
            self.robots.blown_up = self._own(state["blown_up"])
        for name, value in state["buffers"].items():
            setattr(self, name, self._own(value))
        self.commands.value = self._own(state["command"])
        self.history.frames = self._own(state["history"])
        if self.slow is not None:
            self.slow.sums, self.slow.weight = (self._own(state["slow"][name]) for name in ("sums", "weight"))
        self.unsync.window, self.unsync.cursor = self._own(state["unsync"]["window"]), state["unsync"]["cursor"]
        self._observation = self._to_networks(state["observation"])
        self.generator.set_state(state["generator"])

    def _own(self, value: torch.Tensor) -> torch.Tensor:
        """Return a copy of a tensor of a checkpoint, on the device of the task."""
        return value.to(self.task_device, copy=True)

    def _load_host(self, state: dict[str, Any]) -> None:
        """Restore the state of robots on the host."""
        host, fleet = self.host, self.fleet
        fleet.ground[:] = state["ground"].numpy()
        host.law.load_state({name: value.numpy() for name, value in state.get("friction", {}).items()})
        fleet.blown_up[:] = state["blown_up"].numpy()
        if host.motors is not None:
            motors = {name: value.numpy() for name, value in state["motors"].items()}
            fleet.targets[...] = motors.pop("targets")
            host.motors.load_state(motors)
