"""Prediction of a held-out record: in closed loop, and in open loop from restarts, in degrees or millimetres.

Every model is fitted to one part of the log and predicts the rest, or another log: what was chosen, viscous and Coulomb
friction, the textbook's least squares on torque, and no friction at all. A record that is predicted need not tell any
parameter.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from stiction.core.errors import StictionError
from stiction.files.joints import JointRecord
from stiction.identification.in_loop import respond
from stiction.identification.model import Model, nearest_joint
from stiction.identification.output_error import OutputError
from stiction.identification.regression import FEWEST_ROWS, INVERSE_STRENGTH, Fit, fit_rows
from stiction.identification.runs import Run, part_of
from stiction.joints.pd import PDGains
from stiction.joints.simulate import simulate

HORIZONS = (0.1, 0.5, 2.0)
"""Times after a restart over which the open loop is predicted [s]."""

MOST_RESTARTS = 12
"""Maximum number of restarts of one horizon, evenly over the record."""

TRAINED = 0.7
"""Share of a log, from its start, that is fitted where the rest is predicted."""

LEAD = 2.0
"""Time before the predicted record at which the simulation of its loop starts [s]."""

FRICTION = ("viscous_friction", "coulomb_friction")
"""Parameters that are zero in a model without friction."""


@dataclass(frozen=True)
class Prediction:
    """Root-mean-square errors of a model's prediction."""

    model: str
    """`chosen`, `coulomb`, `textbook` or `no friction`."""
    closed_loop: float | None
    """Error of the position in closed loop [rad]; None without gains and target."""
    open_loop: tuple[float | None, ...]
    """Errors of the position driven by the torque of the log, over each of `HORIZONS` after a restart [rad]."""
    torque: float | None
    """Error of the torque in closed loop, over the rms of the log's torque [1]; None without a loop or a torque."""


@dataclass(frozen=True)
class HeldOut:
    """Predictions of one record."""

    source: str
    """Name of the log, or the part of it."""
    seconds: float
    """Length of the record [s]."""
    predictions: tuple[Prediction, ...]

    def error(self, model: str) -> float | None:
        """Return a model's error in closed loop, else that over half a second [rad]; None where neither is known."""
        prediction = next((item for item in self.predictions if item.model == model), None)
        if prediction is None:
            return None
        return prediction.closed_loop if prediction.closed_loop is not None else prediction.open_loop[1]

    @property
    def fails(self) -> bool:
        """True if what was chosen predicts the record no better than no friction at all."""
        chosen, none = self.error("chosen"), self.error("no friction")
        return chosen is not None and none is not None and chosen >= none

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for JSON."""
        return {
            "source": self.source,
            "seconds": self.seconds,
            "horizons": list(HORIZONS),
            "predictions": [vars(prediction) for prediction in self.predictions],
        }


Values = tuple[Model, Mapping[str, float]]
"""A torque equation and its parameters by name."""


def hold_out(
    run: Run, base: Fit, chosen: Fit, simulated: Sequence[OutputError | None], other: Run | None
) -> HeldOut | None:
    """Predict a record that the models have not seen; None where the log is too short to be cut.

    base, chosen: regressions with viscous and Coulomb friction, and with the law that was chosen; simulated: output
    error with either, None where it was not done; other: another log, by default the last part of this one.
    """
    if INVERSE_STRENGTH in base.names:
        return None
    count = len(run.signals.time)
    seen = np.arange(count) < (count if other is not None else int(TRAINED * count))
    models = _models(run, base, chosen, simulated, seen)
    if models is None:
        return None
    record = other or run
    judged = record.signals.valid & (np.ones(len(record.signals.time), bool) if other is not None else ~seen)
    record = replace(record, reading=run.reading)
    seconds = float(judged.sum() * record.signals.step)
    if other is None:
        record, judged = _last_part(record, judged)
    predictions: dict[str, Prediction] = {}
    for name, model in models.items():
        # Both are one where no richer law was chosen.
        same = predictions.get("chosen") if model == models["chosen"] else None
        predictions[name] = replace(same, model=name) if same else _predict(name, *model, record, judged)
    source = record.source if other is not None else f"last {1 - TRAINED:.0%} of {run.source}"
    return HeldOut(source, seconds, tuple(predictions.values()))


def predicts(record: JointRecord) -> bool:
    """Return True if what was chosen predicts an unseen record in its loop."""
    held = record.diagnostics.get("held_out") or {"predictions": ()}
    return any(
        prediction["model"] == "chosen" and prediction["closed_loop"] is not None for prediction in held["predictions"]
    )


def _last_part(run: Run, judged: np.ndarray) -> tuple[Run, np.ndarray]:
    """Return the part of a run to simulate for its judged samples, and their mask, shape (num_samples,).

    A simulation forgets its initial state well within `LEAD`.
    """
    first = max(0, int(np.argmax(judged)) - round(LEAD / run.signals.step))
    return part_of(run, slice(first, None)), judged[first:]


def _models(
    run: Run, base: Fit, chosen: Fit, simulated: Sequence[OutputError | None], seen: np.ndarray
) -> dict[str, Values] | None:
    """Return the models fitted to the seen samples of a run; None where these are too few."""
    rows = base.rows.take(seen[run.prepared.used]) if len(base.rows) == len(run.prepared.used) else base.rows
    if len(rows) < FEWEST_ROWS:
        return None
    textbook = fit_rows(rows, base.model)
    models: dict[str, Values] = {"textbook": (base.model, textbook.by_name)}
    for name, fit, best in (("coulomb", base, simulated[0]), ("chosen", chosen, simulated[1])):
        if best is not None:
            part = best.part(seen & run.signals.valid) if not seen.all() else best.estimates
            if part is None:
                return None
            values = {key: estimate.value for key, estimate in part.items()}
        elif fit.model.law == "breakaway":
            values = dict(fit.by_name)
        else:
            values = fit_rows(rows, fit.model).by_name
        models[name] = (fit.model, values)
    bare = {name: 0.0 if name in FRICTION else value for name, value in models["coulomb"][1].items()}
    return {"chosen": models["chosen"], "coulomb": models["coulomb"], "textbook": models["textbook"]} | {
        "no friction": (base.model, bare)
    }


def _predict(name: str, model: Model, values: Mapping[str, float], record: Run, judged: np.ndarray) -> Prediction:
    """Predict the judged samples of a record with one model."""
    closed = torque = None
    try:
        response = respond(record, model, dict(values))
        closed = _rms((response.position - record.signals.position)[judged])
        if record.signals.torque is not None:
            size = _rms(record.signals.torque[judged])
            torque = _rms((response.torque - record.signals.torque)[judged]) / max(size, 1e-300)
    except StictionError:
        closed = torque = None
    return Prediction(name, closed, tuple(_open_loop(model, values, record, judged, span) for span in HORIZONS), torque)


def _open_loop(
    model: Model, values: Mapping[str, float], record: Run, judged: np.ndarray, horizon: float
) -> float | None:
    """Return the error over a horizon after restarts from the measured state [rad]; None where that cannot be done."""
    signals, step = record.signals, record.signals.step
    length = round(horizon / step) + 1
    whole = nearest_joint({name: float(values.get(name, 0.0)) for name in model.names})
    # A torque that is made from positions would bring them back.
    if record.setup.payload is not None or not record.measured:
        return None
    try:
        joint = model.joint([whole[name] for name in model.names])
    except StictionError:
        return None
    pushed = record.driven if signals.disturbance is None else record.driven + signals.disturbance
    starts = [start for start in range(0, len(judged) - length, length) if judged[start : start + length].all()]
    chosen = starts[:: max(1, -(-len(starts) // MOST_RESTARTS))]
    # A spring too weak to matter, for the simulation is of a joint under a controller.
    gains, errors = PDGains(kp=1e-9, kd=0.0), []
    for start in chosen:
        part = slice(start, start + length)
        begin = float(record.prepared.position[start]), float(record.prepared.velocity[start])
        try:
            motion = simulate(joint, gains, step, np.zeros(length), *begin, pushed[part], signals.position[part])
        except StictionError:
            return None
        errors.append(float(np.mean((motion.position - signals.position[part]) ** 2)))
    return float(np.sqrt(np.mean(errors))) if errors else None


def _rms(values: np.ndarray) -> float:
    """Return the root mean square."""
    return float(np.sqrt(np.mean(values**2)))


def prediction_text(held: Mapping[str, Any], axis: str) -> str:
    """Return the errors of `HeldOut.to_dict` in words: `0.012° in closed loop, without friction 1.3°`.

    axis: `rotary` or `linear`.
    """
    errors = {prediction["model"]: prediction for prediction in held["predictions"]}
    closed = errors["chosen"]["closed_loop"] is not None
    place = "in closed loop" if closed else f"over {HORIZONS[1]:g} s from a restart"
    known = {
        model: value
        for model, prediction in errors.items()
        if (value := prediction["closed_loop"] if closed else prediction["open_loop"][1]) is not None
    }
    words = {"coulomb": "with viscous and Coulomb friction alone", "textbook": "by the textbook's regression"}
    parts = [f"{angle_text(known['chosen'], axis)} {place}"] if "chosen" in known else ["not known"]
    parts += [
        f"{words.get(model, model)} {angle_text(value, axis)}" for model, value in known.items() if model != "chosen"
    ]
    return ", ".join(parts)


def predictions_text(records: Mapping[str, JointRecord]) -> str:
    """Return the range of the errors of several joints, with and without friction; empty where none is known."""
    ranges = {}
    for model in ("chosen", "no friction"):
        known = [
            (prediction["closed_loop"], record.axis)
            for record in records.values()
            for prediction in (record.diagnostics.get("held_out") or {"predictions": ()})["predictions"]
            if prediction["model"] == model and prediction["closed_loop"] is not None
        ]
        if known:
            ranges[model] = " to ".join(angle_text(value, axis) for value, axis in (min(known), max(known)))
    if "chosen" not in ranges:
        return ""
    without = f", without friction {ranges['no friction']}" if "no friction" in ranges else ""
    return f"held out, of {len(records)} joints: {ranges['chosen']} in closed loop{without}"


def angle_text(value: float, axis: str) -> str:
    """Return an rms error of the position in degrees, or in millimetres for a linear axis."""
    return f"{1e3 * value:.2g} mm" if axis == "linear" else f"{np.rad2deg(value):.2g}°"
