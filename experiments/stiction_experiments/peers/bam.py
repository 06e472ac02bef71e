"""BAM (better-actuator-models) as an estimator: its friction laws and its simulator, searched by least squares.

Its command `bam.fit` is for recorded pendulums of known mass, and searches by CMA-ES over 100,000 trials. Here its
simulator steps many candidates at once, and least squares on the position begins from many of them. It is judged by its
own simulator: its steps move the position ahead of the velocity, so that its numbers belong to them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from stiction.core.errors import StictionError
from stiction_experiments.peers.judge import Fitted
from stiction_experiments.peers.plain import GRAVITY
from stiction_experiments.peers.records import Problem, part_of_problem

INSTALL = "pip install --no-deps better-actuator-models, with --ignore-requires-python on another Python than 3.12"
"""Command that installs the package: of it only laws and simulator are used, which need NumPy alone."""

LAWS = ("m1", "m2", "m6")
"""Friction laws that are tried: Coulomb; with Stribeck; with load by direction and its square as well."""

SHIFTS = (0.0, 0.5, 1.0)
"""Lateness of the target in samples: BAM has no late controller, so its user shifts the target."""

STARTS, KEPT = 24, 2
"""Candidates that are simulated at first, and the best ones from which least squares begins."""

MOST_ROUNDS = 8
"""Rounds of least squares."""

SPREAD = 0.5
"""Standard deviation of the candidates' logarithm about the regression's values [1]."""

SEEN = 0.8
"""Share of the first part that laws are fitted to when one is chosen by the rest of it."""


def models() -> dict[str, Callable[[], Any]]:
    """Return BAM's laws by name. Raises `StictionError` where it is not installed."""
    try:
        from bam.model import models as laws
    except ImportError as error:
        raise StictionError(f"BAM is not installed; {INSTALL}") from error
    return laws


def make_model(law: str, problem: Problem, start: dict[str, float]) -> Any:
    """Return a BAM model of the joint under its known controller; bounds and starts follow from the regression."""
    from bam.actuator import Actuator
    from bam.parameter import Parameter
    from bam.testbench import Testbench

    torque = max(abs(start["coulomb_friction"]), 1e-3 * problem.kp * float(np.ptp(problem.position)))
    late = round(problem.velocity_delay / problem.step)

    class Link(Testbench):
        """A link whose weight and offset are unknown; all inertia is the actuator's."""

        def __init__(self, log: dict[str, Any]) -> None:
            self.model = log["model"]

        def compute_mass(self, q: Any, dq: Any) -> Any:
            return 0.0 * q

        def compute_bias(self, q: Any, dq: Any) -> Any:
            model = self.model
            weight = 0.0
            if problem.gravity:
                weight = model.gravity_sin.value * np.sin(q) + model.gravity_cos.value * np.cos(q)
            return -(model.offset.value + weight)

    class Driven(Actuator):
        """The controller of the log: known gains and limit, and a velocity that is late by whole samples."""

        def initialize(self) -> None:
            model = self.model
            model.max_friction_base, model.max_load_friction = 20 * torque, 1.0
            model.max_viscous_friction = 20 * max(abs(start["viscous_friction"]), start["inertia"])
            model.armature = Parameter(start["inertia"], 0.05 * start["inertia"], 20 * start["inertia"])
            for name in ("offset", *GRAVITY) if problem.gravity else ("offset",):
                setattr(model, name, Parameter(start[name], start[name] - 20 * torque, start[name] + 20 * torque))

        def reset(self) -> None:
            self.rates: list[Any] = []

        def compute_control(self, q_target: Any, q: Any, dq: Any, dt: float) -> Any:
            self.rates.append(dq)
            asked = problem.kp * (q_target - q) - problem.kd * self.rates[max(0, len(self.rates) - 1 - late)]
            return np.clip(asked, -problem.limit, problem.limit)

        def compute_torque(self, control: Any, torque_enable: bool, q: Any, dq: Any) -> Any:
            return control

        def get_extra_inertia(self) -> Any:
            return self.model.armature.value

    model = models()[law]()
    model.set_actuator(Driven(Link))
    # The weight has a phase and an offset of its own.
    model.q_offset.optimize = False
    model.friction_base.value = torque
    model.friction_viscous.value = max(start["viscous_friction"], 1e-3 * start["inertia"])
    speed = float(np.abs(np.gradient(problem.position, problem.step)).max())
    for name, value in (("friction_stribeck", 0.3 * torque), ("dtheta_stribeck", 0.1 * speed)):
        if hasattr(model, name):
            getattr(model, name).value = value
    if hasattr(model, "dtheta_stribeck"):
        model.dtheta_stribeck.min, model.dtheta_stribeck.max = 1e-3 * speed, speed
    for name, parameter in model.get_parameters().items():
        if "load" in name:
            parameter.value = 0.0 if name.endswith("quad") else 0.02
    return model


@dataclass(frozen=True)
class Search:
    """A law of BAM and the numbers that least squares changes."""

    model: Any
    names: tuple[str, ...]
    begin: np.ndarray
    """Start, shape (P,)."""
    low: np.ndarray
    high: np.ndarray
    shift: float
    """Lateness of the target [s]."""

    @classmethod
    def of(cls, law: str, problem: Problem, start: dict[str, float], shift: float) -> Search:
        """Return the search of a law."""
        model = make_model(law, problem, start)
        free = {name: one for name, one in model.get_parameters().items() if one.optimize}
        begin, low, high = np.array([(one.value, one.min, one.max) for one in free.values()]).T
        return cls(model, tuple(free), np.clip(begin, low, high), low, high, shift)

    def simulate(self, problem: Problem, points: np.ndarray) -> np.ndarray:
        """Return the positions of candidates in BAM's simulator [rad, or m], shape (T, C). points: shape (P, C)."""
        from bam.simulate import Simulator

        for name, values in zip(self.names, points, strict=True):
            getattr(self.model, name).value = values
        targets = problem.targets(problem.time - self.shift)
        still = np.zeros(points.shape[1])
        entries = [{"goal_position": target, "position": 0.0, "torque_enable": True} for target in targets.tolist()]
        entries[0] |= {"position": still + problem.position[0], "speed": still + problem.speed}
        log = {"dt": problem.step, "entries": entries, "model": self.model}
        with np.errstate(all="ignore"):
            positions, _, _ = Simulator(self.model).rollout_log(log, simulate_control=True)
        return np.array(positions)

    def errors(self, problem: Problem, points: np.ndarray) -> np.ndarray:
        """Return the errors of the positions over the position's deviation [1], shape (T, C)."""
        error = (self.simulate(problem, points) - problem.position[:, None]) / float(np.std(problem.position))
        return np.nan_to_num(error, nan=1e3, posinf=1e3, neginf=-1e3).clip(-1e3, 1e3)

    def solve(self, problem: Problem) -> tuple[float, np.ndarray]:
        """Return the lowest mean square error, and the point that has it, shape (P,).

        All starts take their rounds of Levenberg-Marquardt at once: each round simulates the points and their
        derivatives in one batch.
        """
        rng = np.random.default_rng(0)
        width = self.high - self.low
        size = np.maximum(np.abs(self.begin), 0.01 * width)
        drawn = self.begin[:, None] + SPREAD * size[:, None] * rng.standard_normal((len(size), STARTS))
        drawn[:, 0] = self.begin
        drawn = drawn.clip(self.low[:, None], self.high[:, None])
        costs = np.mean(self.errors(problem, drawn) ** 2, axis=0)
        points = drawn[:, np.argsort(costs)[:KEPT]]
        damping, nudge = np.full(KEPT, 1e-2), 1e-4 * size
        for _ in range(MOST_ROUNDS):
            sign = np.where(points + nudge[:, None] > self.high[:, None], -1.0, 1.0)
            moved = points[:, :, None] + np.einsum("p,pk,pq->pkq", nudge, sign, np.eye(len(nudge)))
            batch = np.concatenate([points[:, :, None], moved], axis=2)
            errors = self.errors(problem, batch.reshape(len(nudge), -1)).reshape(len(problem.time), KEPT, -1)
            before = np.mean(errors[:, :, 0] ** 2, axis=0)
            slopes = (errors[:, :, 1:] - errors[:, :, :1]) / (sign.T * nudge)[None]
            trials = np.stack(
                [self._step(points[:, k], slopes[:, k], errors[:, k, 0], size, damping[k]) for k in range(KEPT)], axis=1
            )
            after = np.mean(self.errors(problem, trials) ** 2, axis=0)
            better = after < before
            points = np.where(better, trials, points)
            damping = np.where(better, damping / 5, damping * 5)
            if np.all(np.abs(before - after) < 1e-5 * before):
                break
        costs = np.mean(self.errors(problem, points) ** 2, axis=0)
        best = int(np.argmin(costs))
        return float(costs[best]), points[:, best]

    def _step(
        self, point: np.ndarray, slopes: np.ndarray, error: np.ndarray, size: np.ndarray, damping: float
    ) -> np.ndarray:
        """Return the point of one damped step, kept within its bounds, shape (P,)."""
        scaled = slopes * size
        gram = scaled.T @ scaled
        ridge = damping * np.diag(np.diag(gram) + 1e-12 * np.trace(gram) + 1e-300)
        return np.clip(point - size * np.linalg.solve(gram + ridge, scaled.T @ error), self.low, self.high)


def fit_bam(problem: Problem, textbook: Fitted) -> dict[str, Fitted]:
    """Return two fits of BAM: Coulomb's law, and the law that predicts the end of the first part best.

    textbook: the regression, where the search begins. Raises `StictionError` where BAM is not installed.
    """
    models()
    assert textbook.values is not None
    start = dict(textbook.values) | {"inertia": abs(textbook.values["inertia"])}
    searches = [Search.of("m1", problem, start, shift * problem.step) for shift in SHIFTS]
    solved = [search.solve(problem) for search in searches]
    first = int(np.argmin([cost for cost, _ in solved]))
    search, point = searches[first], solved[first][1]
    best = dict(zip(search.names, point.tolist(), strict=True))
    named = {"inertia": "armature", "viscous_friction": "friction_viscous", "coulomb_friction": "friction_base"}
    start = {name: best[named.get(name, name)] for name in start}
    fits = {"bam-m1": _fitted("m1", search, point)}
    law = chosen_law(problem, start, search.shift)
    if law != "m1":
        search = Search.of(law, problem, start, search.shift)
        point = search.solve(problem)[1]
    return fits | {"bam": _fitted(law, search, point)}


def _fitted(law: str, search: Search, point: np.ndarray) -> Fitted:
    """Return a fit that BAM's own simulator predicts with."""

    def predict(other: Problem) -> np.ndarray:
        return search.simulate(other, point[:, None])[:, 0]

    return Fitted(law, own=predict, note=f"target {search.shift:.2g} s late")


def chosen_law(problem: Problem, start: dict[str, float], shift: float) -> str:
    """Return the law that, fitted to most of the first part, predicts the rest of it best."""
    seen = round(SEEN * len(problem.time))
    begin, errors = part_of_problem(problem, seen), {}
    for law in LAWS:
        search = Search.of(law, begin, start, shift)
        point = search.solve(begin)[1]
        errors[law] = float(np.mean(search.errors(problem, point[:, None])[seen:] ** 2))
    return min(errors, key=lambda law: errors[law])
