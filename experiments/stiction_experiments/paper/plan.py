"""The trainings and walks of the report, as `results/paper/criteria.md` names them."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain

THREE, FIVE = (10, 11, 12), (10, 11, 12, 13, 14)
"""Training seeds: of a sentence about one training; of a difference between two."""

BUDGET = 440
"""Iterations of the preset `quick`."""

BACKWARD = ("vx=-0.2", "vx=-0.35", "vx=-0.5", "vx=-0.65")
"""Commands of the paper's log: its robot walked backward only. Four speeds, so that runs differ."""

EVERYWHERE = ("vx=0.5", "vx=-0.5", "vy=0.3", "vy=-0.3", "wz=0.5", "wz=-0.5")
"""Commands of the control: forward, backward, sideways, turns."""

RUNS = 12
"""Walks in the log of a net: divisible by four commands on three robots, and by six commands on one."""

VIRTUAL = (3000, 3001, 3002, 3003)
"""Virtual robots of the report."""

LEVEL = 0.2
"""Nominal friction, as a share of each joint's torque limit [1]."""


@dataclass(frozen=True)
class Training:
    """One way of training."""

    name: str
    words: tuple[str, ...]
    """Words of `stiction train` behind the preset, without seed and folder; `{net}` is the folder of the net."""
    seeds: tuple[int, ...] = THREE
    net: tuple[str, ...] = ()
    """Logged commands of the Actuator Net that it is trained on; none: no net."""
    logged: int = 1
    """Virtual robots whose walks the net is of."""
    preset: str = "quick"

    @property
    def walks_flat(self) -> bool:
        """True if it walks on flat ground."""
        return "stairs" not in self.words


def _coulomb(name: str, method: str, *more: str, seeds: tuple[int, ...] = FIVE, budget: int = 1) -> Training:
    """Return a training under Coulomb friction; budget: multiple of the preset's iterations."""
    long = ("--teacher.iterations", str(budget * BUDGET)) if budget > 1 else ()
    return Training(name, ("--method", method, "--friction-level", f"{LEVEL:g}", *more, *long), seeds)


def _unit(name: str, law: str, coefficient: float) -> Training:
    """Return direct training under a law whose level is a coefficient."""
    return Training(name, ("--method", "direct", "--friction-law", law, "--friction-level", f"{coefficient:g}"))


def _net(name: str, *commands: str, logged: int = 1) -> Training:
    """Return a training on an Actuator Net of torque behind the gear."""
    return Training(name, ("--method", "none", "--actuator", "{net}"), FIVE, commands, logged)


def own_robot(seed: int) -> int:
    """Return the virtual robot whose walk the net of a training seed is of: the first three, in turn."""
    return VIRTUAL[(seed - THREE[0]) % 3]


def _stairs(name: str, *words: str, seeds: tuple[int, ...] = FIVE, net: tuple[str, ...] = ()) -> Training:
    """Return a training on stairs, with the budget of all of them."""
    budget = ("--terrain", "stairs", "--symmetry", "network", "--teacher.iterations", "900")
    return Training(name, (*words, *budget, "--student.iterations", "170"), seeds, net, preset="two-phase")


WEAK = ("--set", "network.initial_std=0.27")
"""A third of the exploration of the preset."""

SHARP = (
    *("--set", "task.rewards.track_linear=0", "--set", "task.rewards.track_angular=0"),
    *("--task.rewards.own", "stiction_experiments.paper.rewards:sharp_linear", "2"),
    *("stiction_experiments.paper.rewards:sharp_angular", "0.8"),
)
"""Tracking kernels of width 0.006 in place of 0.1 and 0.25."""

NO_PRONK_TERMS = ("base_height", "vertical_velocity", "air_time")
"""Reward terms that forbid a pronk."""


def _without(*terms: str) -> tuple[str, ...]:
    """Return the words that take terms out of the reward."""
    return tuple(word for term in terms for word in ("--set", f"task.rewards.{term}=0"))


PLAIN = _without("trot", "unsync", *NO_PRONK_TERMS)
"""Rewards of a quadruped, and none that forbids a pronk."""

PLAIN_TROT = _without("unsync", *NO_PRONK_TERMS)
"""The same, with r_trot."""

STAGES = ("--set", "task.friction.begin=0.75", "--set", "task.friction.stages=5")
"""Friction that begins at three quarters of a training and grows in five steps."""

MEAN_KEPT = ("--task.friction.range", "0", "2")
"""A range from zero as that of `deception`, about the mean of `direct`."""

LITERAL = (
    *("--terrain", "mixed", "--physics", "rows", "--teacher.both-ways", "--set", "student.both_ways=true"),
    *("--set", "network.critic_history=true", "--set", "network.terrain_loss=false"),
    *("--set", "task.randomization.action_delay=[0, 0]", "--set", "task.randomization.encoder_offset=[0, 0]"),
    *("--set", "task.randomization.standing_start=1", "--set", "task.randomization.center_of_mass_axes=forward"),
    *("--set", "task.noise.angular_velocity=0", "--set", "task.noise.roll_pitch=0"),
    *("--set", "task.noise.joint_position=0", "--set", "task.noise.joint_velocity=0"),
    *("--set", "task.terrain.elevation_noise=0", "--set", "task.rewards.trot=0", "--set", "task.rewards.unsync=0"),
    *("--task.rewards.own", "stiction_experiments.paper.rewards:printed_trot", "1"),
    *("stiction_experiments.paper.rewards:printed_unsync", "-0.6"),
)
"""The paper at its word where the presets do what works better; what is left is listed in results/literal."""

GROUPS: tuple[tuple[Training, ...], ...] = (
    tuple(
        Training(name, ("--method", method, "--friction-level", f"{LEVEL:g}"), FIVE)
        for name, method in (("none", "none"), ("direct", "direct"), ("deception", "deception"))
    ),
    (
        _net("net", *BACKWARD),
        _net("net-all", *EVERYWHERE),
        _net("net-three", *BACKWARD, logged=3),
        Training("deception-1", ("--method", "deception")),
    ),
    (
        _stairs("stairs-none", "--method", "none", "--friction-level", f"{LEVEL:g}", seeds=THREE),
        _stairs("stairs-deception", "--method", "deception", "--friction-level", f"{LEVEL:g}"),
        _stairs("stairs-net", "--method", "none", "--actuator", "{net}", net=BACKWARD),
    ),
    (
        Training("direct-1", ("--method", "direct")),
        _unit("direct-effort", "effort", 0.442),
        _unit("direct-load-5", "load", 0.05),
        _unit("direct-load-44", "load", 0.442),
    ),
    (
        _coulomb("direct-half", "direct", "--robot", "saturn_lite@kp=0.5"),
        _coulomb("direct-half-later", "direct", "--robot", "saturn_lite@kp=0.5", "--set", "task.friction.begin=0.4"),
        _coulomb("none-half", "none", "--robot", "saturn_lite@kp=0.5", seeds=THREE),
        _coulomb("none-double", "none", "--robot", "saturn_lite@kp=2", seeds=THREE),
    ),
    (
        _coulomb("direct-weak", "direct", *WEAK),
        _coulomb("none-weak", "none", *WEAK),
        _coulomb("direct-sharp", "direct", *SHARP, seeds=THREE),
        _coulomb("none-sharp", "none", *SHARP, seeds=THREE),
    ),
    (
        _coulomb("compensated", "compensation", seeds=THREE),
        _coulomb("fine-tuned", "finetune", "--set", "task.friction.begin=0.75", seeds=THREE, budget=4),
        _coulomb("iterative", "iterative", *STAGES, budget=4),
    ),
    (_coulomb("mean-kept", "deception", *MEAN_KEPT),),
    (
        _coulomb("plain", "none", *PLAIN),
        _coulomb("plain-trot", "none", *PLAIN_TROT),
        _coulomb("no-unsync", "none", *_without("unsync")),
        _coulomb("go1-plain", "none", "--robot", "go1", *PLAIN),
        _coulomb("go2-plain", "none", "--robot", "go2", *PLAIN),
    ),
    (
        Training(
            "literal",
            (
                *("--method", "deception", "--task.friction.per", "joint"),
                *("--set", "task.friction.privileged_unit=0.01", *LITERAL),
            ),
            preset="two-phase",
        ),
        Training("literal-none", ("--method", "none", *LITERAL), preset="two-phase"),
    ),
)
"""Trainings in the order of their worth; those of a group are trained, and then walk, together. The first is the cohort
of the whole project."""

COHORT, TRAININGS = GROUPS[0], tuple(chain(*GROUPS))


MAIN = ("none", "direct", "deception", "net")
"""Trainings that are compared in every engine."""

WHOLE = (*MAIN, "literal", "literal-none")
"""Trainings that walk under every friction of a place."""

ON_ROBOTS = ("none", "deception", "net", "net-all", "net-three", "iterative")
"""Trainings of which a sentence asks what they do on a virtual robot."""

WORN = ("none", "deception")
"""Trainings that walk on robots whose joints wear."""

UNDER_LOAD = ("none", "direct-load-5", "direct-load-44")
"""Trainings that walk under friction in proportion to the load."""

GAITS = ("none", "plain", "plain-trot", "no-unsync", "go1-plain", "go2-plain")
"""Trainings whose gait is measured."""


@dataclass(frozen=True)
class Place:
    """Where policies walk: an engine with a robot."""

    name: str
    engine: str
    levels: tuple[str, ...]
    """Friction over the torque limit, or the coefficient of `law`; `bench`: the paper's values."""
    episodes: int
    trainings: tuple[str, ...] = ()
    """Names of the trainings that walk there; none: all."""
    robot: int | None = None
    """Virtual robot; None: the robot of the data sheet."""
    forward: bool = False
    """True if `none` also walks with friction fed forward."""
    law: str = "coulomb"
    """Law of the friction of the robot of the data sheet."""
    few: tuple[str, ...] = ()
    """Levels of trainings that are not compared in every engine; none: all."""

    def levels_of(self, training: Training) -> tuple[str, ...]:
        """Return the friction at which a training's policies walk there."""
        return self.few if self.few and training.name not in WHOLE else self.levels

    def takes(self, training: Training) -> bool:
        """Return whether a training's policies walk there."""
        return training.walks_flat and (not self.trainings or training.name in self.trainings)


LEVELS = ("0", "0.01", "0.05", "0.1", "0.2", "0.3")
"""Friction of the robot of the data sheet, over the torque limit [1]."""

ROBOT_LEVELS = ("bench", "0.05", "0.1", "0.2")
"""Friction of virtual robots; `bench`: the paper's."""

RANGE_ENDS = ("0", "0.24")
"""Ends of the range of `deception`."""

LOADS = ("bench+0.02", "bench+0.1")
"""The paper's friction, and some of the load."""

SEALED, UNSEALED = "0.0098", "0.0029"
"""Friction over the torque limit of the paper's shank with its seals, and with 70 % of it gone [1]."""

PLACES: tuple[Place, ...] = (
    Place("mujoco", "mujoco", LEVELS, 8, few=("0", "0.01", "0.2")),
    Place("mujoco-fine", "mujoco", (UNSEALED, SEALED, "0.03"), 8, ("none", "none-half", "none-double"), few=(SEALED,)),
    Place("mujoco-load", "mujoco", ("0.02", "0.05", "0.1", "0.442"), 8, UNDER_LOAD, law="load"),
    Place("mujoco-effort", "mujoco", ("0.442",), 8, ("direct-effort",), law="effort"),
    Place("physx", "physx", LEVELS[:-1], 2, MAIN),
    *(
        Place(f"robot-{n}", "physx+all", ROBOT_LEVELS, 1, names, n, forward=True, few=("0.2",))
        for numbers, names in ((VIRTUAL[:2], ON_ROBOTS), (VIRTUAL[2:], ON_ROBOTS[:-1]))
        for n in numbers
    ),
    *(Place(f"but-friction-{n}", "physx+rest", ("0",), 1, ("none",), n) for n in VIRTUAL),
    *(Place(f"friction-{n}", "physx+friction", ("bench", "0.1", "0.2"), 1, ("none",), n) for n in VIRTUAL),
    Place("webots", "ode-webots", LEVELS[:-1], 1, MAIN),
    *(Place(f"loaded-{n}", "physx+all", LOADS, 1, ("none",), n) for n in VIRTUAL),
    *(Place(f"ends-{n}", "physx+all", RANGE_ENDS, 1, ("deception",), n) for n in VIRTUAL),
)
"""Every place, in the order of its worth; `robot-`, `loaded-`, `ends-`: all about the robot is its own, `friction-`:
its friction alone, `but-friction-`: all else."""

SECONDS = 10.0
"""Length of a walk, of which the last 8 s count [s]."""

GAIT_WALKS = 8
"""Walks in which a gait is measured."""
