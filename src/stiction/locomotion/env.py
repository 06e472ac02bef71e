"""The task as an rsl_rl `VecEnv`: actions in, observation groups and rewards out. It is computed on the host."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from rsl_rl.env import VecEnv
from tensordict import TensorDict

from stiction.formats.known_friction import kind_average
from stiction.joints.net import ActuatorNet
from stiction.joints.pd import compensated
from stiction.locomotion.config import CommandCfg, TaskCfg
from stiction.locomotion.device import CPU, Device
from stiction.locomotion.gait import UnsyncWindow, exactly_one_group, group_imbalance
from stiction.locomotion.observations import FrameBuilder, History, SlowMeans, roll_pitch
from stiction.locomotion.randomization import FRICTION_UNIT, Randomizer, friction_angle, nominal_joints
from stiction.locomotion.rewards import Snapshot
from stiction.locomotion.terrain import SCAN_POINTS, UNDER, Curriculum
from stiction.robots.catalog import find_robot
from stiction.sim.fleet import Fleet
from stiction.sim.net_motors import NetMotors

RESET_NOISE = (0.1, 0.3)
"""Half-width of the initial joint angles about standing [rad] and of the base's initial velocity [m/s, rad/s]."""

ELEVATION_SCALE = 0.2
"""Unit of the elevation map [m]."""

_BUFFERS = ("episode_length_buf", "last_action", "last_velocity", "air_time", "measured_position", "bench_error")
"""The per-robot buffers that a checkpoint holds beside the simulation."""


def to_tensor(array: np.ndarray) -> torch.Tensor:
    """Return a float32 copy of a live float64 array of the simulation."""
    return torch.from_numpy(array.astype(np.float32))


class CommandSampler:
    """The command of every robot: vx, vy [m/s] and yaw rate [rad/s] in the base frame."""

    def __init__(self, cfg: CommandCfg, num_envs: int) -> None:
        """Start with every robot commanded to stand."""
        self.cfg = cfg
        self.value = torch.zeros(num_envs, 3)

    @property
    def moving(self) -> torch.Tensor:
        """Whether each robot is commanded to move, (N,) bool."""
        return self.value.norm(dim=-1) > self.cfg.moving_above

    def override(self, mask: torch.Tensor, value: torch.Tensor) -> None:
        """Command `value`, (N, 3), to the robots in `mask`, (N,) bool. The tensor is replaced."""
        self.value = torch.where(mask[:, None], value, self.value)

    def draw(self, ids: torch.Tensor, generator: torch.Generator) -> None:
        """Draw new commands for the robots `ids`. The tensor is replaced: observations keep the old one."""
        if not len(ids):
            return
        spans = torch.tensor([self.cfg.forward, self.cfg.sideways, self.cfg.turn])
        new = spans[:, 0] + (spans[:, 1] - spans[:, 0]) * torch.rand(len(ids), 3, generator=generator)
        standing = torch.rand(len(ids), 1, generator=generator) < self.cfg.standing_share
        small = new.norm(dim=-1, keepdim=True) <= self.cfg.moving_above
        value = self.value.clone()
        value[ids] = torch.where(standing | small, 0.0, new)
        self.value = value


class LocomotionEnv(VecEnv):
    """Velocity tracking for any legged robot.

    Observation groups, all float32 and fresh at every step: `proprioception` (o_prio), `history` (o_H, flattened,
    oldest frame first), `privileged` (o_priv), `explicit` (o_exp: base velocity [m/s], foot contacts, and with
    `estimated_friction` that of each kind of joint), and on other than flat ground `elevation` (e_t: how far the ground
    lies below the standing height, in units of 0.2 m).
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
    ) -> None:
        """Build the fleet and reset every robot.

        `identified`: see `nominal_joints`; `device`: simulator, and where observations, rewards and actions are;
        `actuator`: gives the joints' torque in place of the PD law. Raises `StictionError` where the net does not fit
        the robot, the physics step or the friction.
        """
        self.cfg: Any = cfg
        self.num_envs, self.device = num_envs, device.torch
        self.spec = find_robot(cfg.robot)
        self.num_actions = self.spec.num_joints
        flat, draws = cfg.terrain.kind == "flat", np.random.default_rng(seed)
        self.course = None if flat else Curriculum(cfg.terrain, num_envs, draws)
        terrain, sensors = self.course.terrain if self.course else None, cfg.friction.loaded
        steps = (cfg.timestep, cfg.decimation)
        self.fleet = Fleet(self.spec, num_envs, *steps, threads, device.backend, terrain, sensors, cfg.physics)
        self.generator = torch.Generator().manual_seed(seed)
        nominal = nominal_joints(self.fleet, cfg.friction, identified)
        if actuator is not None:
            cfg.check_net(actuator, self.spec)
        self.motors = None if actuator is None else NetMotors(self.fleet, actuator)
        self.randomizer = Randomizer(self.fleet, cfg.randomization, cfg.friction, nominal, self.motors)
        extra = friction_angle(cfg.friction, nominal, self.spec)
        self.compensation = None if extra is None else torch.tensor(extra)
        self.stage = 0
        self.tells_terminal = False
        """Whether a step in which robots time out tells, as `extras["terminal"]`, (N, frame), what they would have
        observed next; `_observe` sees them after their reset."""
        self.commands = CommandSampler(cfg.commands, num_envs)
        self.layout = cfg.layout(self.spec)
        self.standing = torch.from_numpy(self.fleet.standing).float()
        scale = self.spec.action_scale
        self.action_scale = scale if isinstance(scale, float) else torch.from_numpy(scale).float()
        self.torque_limit = torch.from_numpy(self.fleet.torque_limit).float()
        groups = self.spec.groups()
        self.group = None if groups is None else torch.from_numpy(groups)
        self.sideways = torch.tensor(self.spec.sideways_joints)
        self.frames = FrameBuilder(self.layout, self.standing)
        self.history = History(num_envs, self.layout)
        decay = self.layout.slow_kept
        self.slow = None if decay is None else SlowMeans(num_envs, self.num_actions, decay)
        self.unsync = UnsyncWindow(num_envs, len(self.spec.feet))
        self.terms = cfg.rewards.terms_for(self.spec)
        self.max_episode_length = round(cfg.episode / cfg.control_period)
        self.push_interval = round(cfg.randomization.push_interval / cfg.control_period)
        self.command_interval = round(cfg.commands.interval / cfg.control_period)
        self.episode_length_buf = torch.zeros(num_envs, dtype=torch.long)
        self.last_action = torch.zeros(num_envs, self.num_actions)
        self.last_velocity = torch.zeros(num_envs, self.num_actions)
        self.air_time = torch.zeros(num_envs, len(self.spec.feet))
        self.kind_average = torch.from_numpy(kind_average([joint.kind for joint in self.spec.joints])).float()
        self.bench_error = torch.ones(num_envs, self.kind_average.shape[1])
        self._reset(torch.arange(num_envs))
        self._observation = self._observe(torch.ones(num_envs, dtype=torch.bool))

    def get_observations(self) -> TensorDict:
        """Return the current observations."""
        return self._observation

    def step(self, actions: torch.Tensor) -> tuple[TensorDict, torch.Tensor, torch.Tensor, dict]:
        """Apply actions, (N, joints), for one control period; reset robots that fell, blew up or timed out."""
        actions = actions.cpu().clamp(-self.cfg.action_clip, self.cfg.action_clip)
        targets = self.standing + self.action_scale * actions
        if self.compensation is not None:
            targets = compensated(targets, self.measured_position, self.compensation)
        self.fleet.set_targets((targets - self.randomizer.draws.encoder_offset).numpy())
        blown_up = torch.zeros(self.num_envs, dtype=torch.bool)
        blown_up[self.fleet.step()] = True
        self.episode_length_buf = self.episode_length_buf + 1

        snapshot = self._snapshot(actions, blown_up)
        reward = torch.zeros(self.num_envs)
        means = {}
        for name, (term, weight) in self.terms.items():
            value = weight * term(snapshot)
            reward += value
            means[f"reward/{name}"] = value.mean()
        reward = torch.where(blown_up, 0.0, reward * self.cfg.control_period)
        self.last_action = actions

        fallen = snapshot.fallen | blown_up
        time_outs = (self.episode_length_buf >= self.max_episode_length) & ~fallen
        if self.course:
            self.course.walk(self.fleet.qvel[:, :2], self.cfg.control_period)
            left = (self.max_episode_length - self.episode_length_buf) * self.cfg.control_period
            self.course.fall(fallen.numpy(), left.numpy())
            time_outs |= torch.from_numpy(self.course.crossed(self.fleet.base_position[:, :2])) & ~fallen
        dones = fallen | time_outs
        log = means | self._log(snapshot, fallen, blown_up)
        if self.course:
            log |= {name: torch.tensor(value) for name, value in self.course.figures().items()}
        extras: dict[str, Any] = {"time_outs": time_outs.float().to(self.device), "log": log}
        if self.tells_terminal and time_outs.any():
            extras["terminal"] = self._frame_without_reset().to(self.device)
        self._reset(dones.nonzero().flatten())
        self._push_and_command(dones)
        self._observation = self._observe(dones)
        return self._observation, reward.to(self.device), dones.to(self.device), extras

    def enter_stage(self, number: int) -> None:
        """Go over to a stage of the friction's schedule."""
        self.stage = number
        self.randomizer.enter(self.cfg.friction.schedule[number].mixture, self.generator)

    def _snapshot(self, actions: torch.Tensor, blown_up: torch.Tensor) -> Snapshot:
        """Collect what the rewards see."""
        fleet = self.fleet
        velocity = to_tensor(fleet.joint_velocity)
        acceleration = (velocity - self.last_velocity) / self.cfg.control_period
        self.last_velocity = velocity
        contact = torch.from_numpy(fleet.foot_contact)
        landed = torch.where(contact, self.air_time, 0.0)
        self.air_time = torch.where(contact, 0.0, self.air_time + self.cfg.control_period)
        self.linear_velocity = to_tensor(fleet.base_linear_velocity)
        self.contact = contact
        deviation = to_tensor(fleet.joint_position) - self.standing
        quaternion = to_tensor(fleet.base_quaternion)
        w, x, y, z = quaternion.unbind(-1)
        if self.group is None:
            one_group, unsync = torch.zeros(self.num_envs, dtype=torch.bool), torch.zeros(self.num_envs)
        else:
            one_group = exactly_one_group(contact, self.group)
            unsync = self.unsync.push(group_imbalance(contact, self.group))
        return Snapshot(
            command=self.commands.value,
            moving=self.commands.moving,
            linear_velocity=self.linear_velocity,
            angular_velocity=to_tensor(fleet.base_angular_velocity),
            up=torch.stack((2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)), -1),
            height_error=to_tensor(fleet.base_position[:, 2] - fleet.ground) - self.spec.standing_height,
            torque_share=to_tensor(fleet.torque) / self.torque_limit,
            joint_deviation=deviation,
            sideways_deviation=deviation[:, self.sideways],
            joint_acceleration=acceleration,
            action_change=actions - self.last_action,
            contact=contact,
            one_group=one_group,
            unsync=unsync,
            landed_air_time=landed,
            fallen=torch.from_numpy(fleet.fallen()) & ~blown_up,
        )

    def _log(self, snapshot: Snapshot, fallen: torch.Tensor, blown_up: torch.Tensor) -> dict[str, torch.Tensor]:
        """Return the figures of the walk in this step, scalars."""
        moving = snapshot.moving.float()
        error = (snapshot.command[:, :2] - snapshot.linear_velocity[:, :2]).norm(dim=-1)
        log = {
            "walk/tracking_error": error.mean(),
            "walk/tripod_share": (snapshot.one_group * moving).sum() / moving.sum().clamp(min=1.0),
            "walk/falls": fallen.float().mean() / self.cfg.control_period,
            "walk/blown_up": blown_up.sum().float(),
        }
        command = snapshot.command[:, 0]
        ratio = snapshot.linear_velocity[:, 0] / command
        for name, mask in (("forward", command > 0.3), ("backward", command < -0.3)):
            log[f"walk/{name}_ratio"] = torch.where(mask, ratio, 0.0).sum() / mask.sum().clamp(min=1)
        if any(law.spec.reads for law in self.cfg.friction.laws):
            log["friction/share"] = torch.as_tensor((self.fleet.friction / self.fleet.torque_limit).mean())
        return log

    def _reset(self, ids: torch.Tensor) -> None:
        """Start new episodes with newly drawn robots."""
        if not len(ids):
            return
        num, joints = len(ids), self.num_actions
        self.randomizer.draw(ids, self.generator)
        angle, speed = RESET_NOISE

        def symmetric(width: int, size: float) -> np.ndarray:
            return (size * (2 * torch.rand(num, width, generator=self.generator) - 1)).double().numpy()

        joint_position, heading = self.fleet.standing + symmetric(joints, angle), symmetric(1, np.pi)[:, 0]
        velocity, start = symmetric(6, speed), None
        if self.course:
            difficulty, uniform, start, heading = self.course.begin(ids.numpy())
            self.fleet.place_terrain(ids.numpy(), difficulty, uniform)
        self.fleet.reset(ids.numpy(), joint_position, heading, velocity, start)
        self.commands.draw(ids, self.generator)
        if self.cfg.known_friction:
            low, high = self.cfg.randomization.known_friction
            size = (num, self.bench_error.shape[1])
            self.bench_error[ids] = low + (high - low) * torch.rand(size, generator=self.generator)
        self.unsync.reset(ids)
        self.episode_length_buf[ids] = 0
        for buffer in (self.last_action, self.last_velocity, self.air_time):
            buffer[ids] = 0.0

    def _push_and_command(self, fresh: torch.Tensor) -> None:
        """Push robots and draw new commands where their time has come."""
        age = self.episode_length_buf
        if self.push_interval:
            ids = ((age % self.push_interval == 0) & ~fresh).nonzero().flatten()
            bound = self.cfg.randomization.push_velocity
            push = bound * (2 * torch.rand(len(ids), 2, generator=self.generator) - 1)
            self.fleet.push(push.double().numpy(), ids.numpy())
        self.commands.draw(((age % self.command_interval == 0) & ~fresh).nonzero().flatten(), self.generator)

    def _observe(self, fresh: torch.Tensor) -> TensorDict:
        """Build every observation group from the state after resets and pushes."""
        elevation = self._look_around() if self.course else {}
        frame = self._frame(fresh)
        velocity = to_tensor(self.fleet.base_linear_velocity)
        explicit = [velocity, to_tensor(self.fleet.foot_contact)]
        if self.cfg.estimated_friction:
            explicit.append(self.randomizer.friction_share() @ self.kind_average / FRICTION_UNIT)
        groups = {
            "proprioception": frame,
            "history": self.history.push(frame, fresh),
            "privileged": self.randomizer.privileged(),
            "explicit": torch.cat(explicit, -1),
            **elevation,
        }
        return self._hand_out(groups)

    def _frame(self, fresh: torch.Tensor) -> torch.Tensor:
        """Measure, with noise, and return one frame of every robot, (N, frame_size); `fresh`: as of `History.push`."""
        fleet, noise = self.fleet, self.cfg.noise
        raw = {
            "angular_velocity": to_tensor(fleet.base_angular_velocity),
            "roll_pitch": roll_pitch(to_tensor(fleet.base_quaternion)),
            "joint_position": to_tensor(fleet.joint_position) + self.randomizer.draws.encoder_offset,
            "joint_velocity": to_tensor(fleet.joint_velocity),
        }
        for name, value in raw.items():
            raw[name] = value + getattr(noise, name) * (2 * torch.rand(value.shape, generator=self.generator) - 1)
        self.measured_position = raw["joint_position"]
        raw |= {"command": self.commands.value, "last_action": self.last_action}
        if self.cfg.known_friction:
            raw["known_friction"] = self.randomizer.unloaded_share() @ self.kind_average * self.bench_error
        if self.slow is not None:
            error = self.standing + self.action_scale * self.last_action - self.measured_position
            raw |= self.slow.push(error, raw["joint_velocity"], fresh)
        return self.frames(raw)

    def _frame_without_reset(self) -> torch.Tensor:
        """Return the frame that every robot would see next if none began anew, (N, frame_size)."""
        kept = None if self.slow is None else (self.slow.sums, self.slow.weight)
        frame = self._frame(torch.zeros(self.num_envs, dtype=torch.bool))
        if self.slow is not None and kept is not None:
            self.slow.sums, self.slow.weight = kept
        return frame

    def _hand_out(self, groups: dict[str, torch.Tensor]) -> TensorDict:
        """Return observation groups where the networks are."""
        return TensorDict({name: value.to(self.device) for name, value in groups.items()}, batch_size=[self.num_envs])

    def _look_around(self) -> dict[str, torch.Tensor]:
        """Hold the robots on their courses, find the ground under them, and return the elevation map as a group."""
        assert self.course is not None
        fleet = self.fleet
        on_course = torch.from_numpy(self.course.on_course)
        self.commands.override(on_course, to_tensor(self.course.command(fleet.yaw)))
        scan = fleet.ground_around(SCAN_POINTS)
        fleet.ground[:] = scan[:, UNDER].mean(-1)
        below = to_tensor(fleet.base_position[:, 2:3] - self.spec.standing_height - scan)
        noise = 2 * torch.rand(below.shape, generator=self.generator) - 1
        return {"elevation": ((below + self.cfg.terrain.elevation_noise * noise) / ELEVATION_SCALE).clamp(-5.0, 5.0)}

    def state(self) -> dict[str, Any]:
        """Return everything the next step depends on, for a checkpoint."""
        friction = self.randomizer.law.state()
        return ({"friction": friction} if friction else {}) | {
            "simulation": self.fleet.simulation.state(),
            "draws": dict(vars(self.randomizer.draws)),
            "buffers": {name: getattr(self, name) for name in _BUFFERS},
            "command": self.commands.value,
            "history": self.history.frames,
            "slow": {} if self.slow is None else {"sums": self.slow.sums, "weight": self.slow.weight},
            "unsync": {"window": self.unsync.window, "cursor": self.unsync.cursor},
            "observation": dict(self._observation.items()),
            "generator": self.generator.get_state(),
            "blown_up": self.fleet.blown_up,
            "stage": self.stage,
            "course": self.course.state() if self.course else None,
            "ground": self.fleet.ground,
            "motors": {} if self.motors is None else self.motors.state() | {"targets": self.fleet.targets.copy()},
        }

    def load_state(self, state: dict[str, Any]) -> None:
        """Restore what `state` returned; the next step is then bit-identical on the same number of threads."""
        # Older states are without schedules, terrain and Actuator Nets.
        state = {"stage": 0, "course": None, "ground": torch.zeros(self.num_envs), "motors": {}} | state
        for name, value in state["draws"].items():
            setattr(self.randomizer.draws, name, value.clone())
        self.stage = state["stage"]
        self.randomizer.mixture = self.cfg.friction.schedule[self.stage].mixture
        self.randomizer.apply(torch.arange(self.num_envs))
        if self.course:
            self.course.load_state(state["course"])
            self.fleet.show_terrain(np.arange(self.num_envs))
        self.fleet.ground[:] = state["ground"].numpy()
        self.fleet.simulation.load_state({name: value.numpy() for name, value in state["simulation"].items()})
        self.randomizer.law.load_state({name: value.numpy() for name, value in state.get("friction", {}).items()})
        for name, value in state["buffers"].items():
            setattr(self, name, value.clone())
        self.commands.value = state["command"].clone()
        self.history.frames = state["history"].clone()
        if self.slow is not None:
            self.slow.sums, self.slow.weight = (state["slow"][name].clone() for name in ("sums", "weight"))
        self.unsync.window, self.unsync.cursor = state["unsync"]["window"].clone(), state["unsync"]["cursor"]
        self._observation = self._hand_out(state["observation"])
        self.generator.set_state(state["generator"])
        self.fleet.blown_up[:] = state["blown_up"].numpy()
        if self.motors is not None:
            motors = {name: value.numpy() for name, value in state["motors"].items()}
            self.fleet.targets[...] = motors.pop("targets")
            self.motors.load_state(motors)
