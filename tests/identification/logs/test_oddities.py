"""Logs as loggers write them: each oddity gives the right value, or one sentence with the remedy."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import stiction
from dry_joint import DECLARED, FRICTION, INERTIA, TITLES, log_rows, measured, simulate, table
from stiction.core.errors import LogError, StictionError

Odd = Callable[[np.ndarray], np.ndarray]

RNG = np.random.default_rng
TURN = 2 * np.pi


def kept(rows: np.ndarray, which: np.ndarray) -> np.ndarray:
    """Return some rows."""
    return rows[which]


def column(rows: np.ndarray, index: int, values: Any) -> np.ndarray:
    """Return rows with another column."""
    copy = np.array(rows)
    copy[:, index] = values
    return copy


def uneven(gaps: Callable[[np.random.Generator, int], np.ndarray]) -> np.ndarray:
    """Return exact samples of the joint, `gaps` simulation steps of 0.125 ms apart."""
    full = simulate(15.0, 1.25e-4)
    places = np.cumsum(gaps(RNG(5), 20000))
    return measured(full[places[places < len(full)]])


def held(rate: float, roles: tuple[int, ...] = (1, 3), offset: int = 0) -> np.ndarray:
    """Return rows at 500 Hz in which the columns `roles` are readings at a lower rate [Hz]."""
    full, rows = simulate(), log_rows()
    every = round(1 / (rate * 2e-4))
    last = np.maximum((np.arange(0, len(full), 10) - offset) // every * every + offset, 0)
    for role in roles:
        values = full[last, role]
        rows[:, role] = np.round(values, 4) if role == 1 else values
    return rows


def irregular() -> np.ndarray:
    """Return rows at 500 Hz whose readings are held over 1 to 12 rows."""
    full = simulate()[::10]
    reads = np.cumsum(RNG(2).integers(1, 13, len(full)))
    last = np.concatenate(([0], reads[reads < len(full)]))[np.searchsorted(reads, np.arange(len(full)), side="right")]
    return np.column_stack([full[:, 0], np.round(full[last, 1], 4), full[:, 2], full[last, 3]])


STAMPS: dict[str, tuple[Callable[[], np.ndarray], str]] = {
    "loop that is not real time": (
        lambda: uneven(lambda rng, n: np.where(rng.random(n) < 0.7, 10, rng.integers(30, 50, n))),
        "time stamps are uneven, 0.00125 to 0.00613 s apart",
    ),
    "steps of 1 to 3 ms": (lambda: uneven(lambda rng, n: rng.integers(8, 25, n)), "uneven"),
    "exponential steps": (lambda: uneven(lambda rng, n: 1 + rng.exponential(16, n).astype(int)), "uneven"),
    "stalls": (lambda: uneven(lambda rng, n: np.where(rng.random(n) < 0.99, 16, 500)), "longer gaps are not used"),
    "stamps rounded to ms": (
        lambda: column(u := uneven(lambda rng, n: rng.integers(8, 25, n)), 0, np.round(u[:, 0], 3)),
        "uneven",
    ),
    "four of ten rows lost": (lambda: kept(log_rows(), RNG(3).random(7500) > 0.4), "uneven"),
    "a gap of 3 s": (lambda: kept(log_rows(), abs(simulate()[::10, 0] - 8) > 1.5), "pauses once for 3"),
    "a pause of 100 s": (lambda: column(r := log_rows(), 0, r[:, 0] + 100.0 * (r[:, 0] > 7)), "pauses once for 100"),
    "clock that begins again": (
        lambda: column(r := log_rows(), 0, np.where(r[:, 0] > 7, r[:, 0] - 7, r[:, 0])),
        "the clock begins again at sample 3502",
    ),
    "newest row first": (lambda: log_rows()[::-1], "newest row first"),
    "rows in pairs exchanged": (
        lambda: log_rows().reshape(-1, 2, 4)[:, ::-1].reshape(-1, 4),
        "3750 samples came out of order",
    ),
    "rows shuffled": (lambda: RNG(0).permutation(log_rows()), "came out of order"),
    "stamps of arrival": (
        lambda: column(r := log_rows(), 0, np.sort(r[:, 0] + 6e-4 * RNG(0).standard_normal(len(r)))),
        "even ones were used",
    ),
    "stamps of 10 ms": (lambda: column(r := log_rows(), 0, np.round(r[:, 0], 2)), "rounded to 0.01 s"),
    "each row twice": (lambda: np.repeat(log_rows(), 2, axis=0), "7500 rows repeat another one exactly"),
    "the file twice": (lambda: np.tile(log_rows(), (2, 1)), "7500 rows repeat another one exactly"),
    "a stamp of zero": (
        lambda: column(r := log_rows(), 0, np.where(np.arange(len(r)) == 3000, 0, r[:, 0])),
        "1 samples have a stamp far from",
    ),
}

READINGS: dict[str, tuple[Callable[[], np.ndarray], str]] = {
    "both at 100 Hz": (lambda: held(100), "last reading of position and torque: each was used once, one every 0.01 s"),
    "position at 100 Hz": (lambda: held(100, (1,)), "last reading of position: each"),
    "torque at 100 Hz": (lambda: held(100, (3,)), "last reading of torque: each"),
    "in turn": (lambda: column(held(100, (1,)), 3, held(100, (3,), 20)[:, 3]), "position and torque"),
    "irregular": (irregular, "position and torque"),
}


@pytest.mark.parametrize("case", [*STAMPS, *READINGS])
def test_the_friction_is_right_and_the_oddity_is_said(tmp_path: Path, case: str) -> None:
    """Gives friction within 2 % and inertia within 1 % of the truth, and one sentence on the log."""
    made, warning = (STAMPS | READINGS)[case]
    log = stiction.load_log(table(tmp_path / "log.csv", made()))
    result = stiction.identify(log, **DECLARED)
    assert result["j"].coulomb_friction.value == pytest.approx(FRICTION, rel=0.02)
    assert result["j"].inertia.value == pytest.approx(INERTIA, rel=0.01)
    assert warning in " ".join(result.warnings)


def test_slow_readings_give_what_an_even_log_of_them_gives() -> None:
    """Readings at 50 Hz in rows at 500 Hz: 2 % low, as the log at 50 Hz, whose intervals hold the difference."""
    even = measured(simulate()[::100], noise=0.0)
    values = []
    for rows in (held(50), even):
        time, position, target, torque = rows.T
        log = stiction.from_arrays(time=time, position={"j": position}, target={"j": target}, torque={"j": torque})
        values.append(stiction.identify(log, **DECLARED)["j"].coulomb_friction.value)
    assert values[0] == pytest.approx(values[1], rel=0.005) and values[0] == pytest.approx(FRICTION, rel=0.04)


def at_rest() -> np.ndarray:
    """Return the joint held at its place for a second after every two."""
    rows = log_rows()
    time = rows[:, 0]
    resting = time % 3 > 2
    last = np.maximum.accumulate(np.where(resting, 0, np.arange(len(rows))))
    return column(rows, 1, rows[last, 1])


@pytest.mark.parametrize(
    "rows",
    [
        lambda: measured(simulate()[::10], 1.5e-3),
        lambda: measured(simulate()[::10], 6e-3),
        lambda: column(r := measured(simulate()[::10], 1.5e-3), 3, np.round(r[:, 3] / 0.05) * 0.05),
        lambda: measured(simulate(15.0, 2e-4, 0.01)[::10], noise=0.0),
        lambda: simulate()[::10],
        at_rest,
    ],
    ids=["4096 steps", "1024 steps", "coarse torque", "torque commanded at 100 Hz", "simulation", "rests"],
)
def test_what_repeats_for_good_reason_is_no_held_reading(rows: Callable[[], np.ndarray]) -> None:
    """Leaves encoders with few steps, joints at rest and commands that the drive holds as they are."""
    from stiction.identification.readings import take_readings

    time, position, target, torque = rows().T
    table = {"position": position, "target": target, "torque": torque}
    same, taken, notes = take_readings(time, table)
    assert same is time and taken == table and notes == ()


def rewritten(change: Callable[[str], str], encoding: str = "utf-8") -> Callable[[Path, np.ndarray], Path]:
    """Return a writer of a table that is changed as text."""

    def write(path: Path, rows: np.ndarray) -> Path:
        path.write_bytes(change(table(path, rows).read_text()).encode(encoding))
        return path

    return write


def titled(header: str, scales: tuple[float, ...] = (1, 1, 1, 1)) -> Callable[[Path, np.ndarray], Path]:
    """Return a writer of a table with other titles and units."""
    return lambda path, rows: table(path, rows * scales, header, form="%.12g")


def wrapped(rows: np.ndarray, turn: float, low: float) -> np.ndarray:
    """Return rows whose angles are from `low` to `low` and a turn, and pass there."""
    copy = np.array(rows)
    copy[:, 1:3] = np.mod(rows[:, 1:3] + 0.1, turn) + low
    return copy


DEG = np.rad2deg(1.0)

TABLES: dict[str, Callable[[Path, np.ndarray], Path]] = {
    "comma behind the titles": titled(f"{TITLES},"),
    "two commas behind the titles": titled(f"{TITLES},,"),
    "commas behind the rows": rewritten(lambda text: text.replace("\n", ",\n").replace(f"{TITLES},", TITLES)),
    "commas behind all": rewritten(lambda text: text.replace("\n", ",\n")),
    "semicolons and decimal commas": rewritten(
        lambda text: (
            text.replace(",", ";")
            .replace(TITLES.replace(",", ";"), TITLES.replace(",", ";") + ";")
            .replace("\n", "\r\n")
            .replace("0.", "0,")
            .replace("1.", "1,")
            .replace("2.", "2,")
        )
    ),
    "tabs": rewritten(lambda text: text.replace(",", "\t").replace("torque.j", "torque.j\t")),
    "blanks": rewritten(lambda text: "  " + text.replace(",", "   ").replace("\n", "\n  ")),
    "byte order mark": rewritten(str, "utf-8-sig"),
    "UTF-16": rewritten(str, "utf-16"),
    "UTF-16 without a mark": rewritten(str, "utf-16-le"),
    "ends of Windows": rewritten(lambda text: text.replace("\n", "\r\n"), "utf-8-sig"),
    "quoted titles": titled('"time","position.j","target.j","torque.j"'),
    "comments": rewritten(lambda text: f"# bench 3, run 2\n# 2024\n\n{text}"),
    "titles in a comment": titled(f"# {TITLES}"),
    "titles of a bench": rewritten(lambda text: f"Logger 3\nDate, 2024\n{text}"),
    "units in brackets": titled("time [s],position.j [rad],target.j [rad],torque.j [Nm]"),
    "units and capitals": titled("Time (s),Position.j (rad),Target.j (rad),Torque.j (N m)"),
    "degrees": titled("time,position.j [deg],target.j [deg],torque.j [Nm]", (1, DEG, DEG, 1)),
    "degrees and radians": titled("time,position.j (deg),target.j (rad),torque.j (mNm)", (1, DEG, 1, 1000)),
    "index": lambda path, rows: table(path, np.column_stack([np.arange(len(rows)), rows]), f",{TITLES}"),
    "Unnamed: 0": lambda path, rows: table(path, np.column_stack([np.arange(len(rows)), rows]), f"Unnamed: 0,{TITLES}"),
    "the same title twice": lambda path, rows: table(path, np.column_stack([rows, rows[:, :2]]), f"{TITLES},x,x"),
    "cut in a number": rewritten(lambda text: text + "15.0,0.1,0.2,0.3"),
    "cut in a row": rewritten(lambda text: text + "15.0,0."),
    "ms": titled(TITLES, (1000, 1, 1, 1)),
    "µs in the title": titled(TITLES.replace("time", "time_us"), (1e6, 1, 1, 1)),
    "ns": titled(TITLES, (1e9, 1, 1, 1)),
    "ms since 1970": lambda path, rows: table(path, rows * (1000, 1, 1, 1) + np.eye(4)[0] * 1.7e12, form="%.17g"),
    "µs that wrap": lambda path, rows: table(
        path, column(rows, 0, np.mod(np.rint(1e6 * rows[:, 0]) + 2**32 - 5e6, 2**32)), TITLES.replace("time", "t [us]")
    ),
    "a clock of 16 bits": lambda path, rows: table(path, column(rows, 0, np.mod(1000 * rows[:, 0] + 60000, 2**16))),
    "wraps at pi": lambda path, rows: table(path, wrapped(rows, TURN, -np.pi)),
    "wraps at 360": lambda path, rows: table(
        path, wrapped(rows * (1, DEG, DEG, 1), 360.0, 0.0), "time,position.j [deg],target.j [deg],torque.j"
    ),
}


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("case", TABLES)
def test_a_table_is_read_as_it_is_meant(tmp_path: Path, case: str) -> None:
    """Gives time, position, target and torque as written, in SI units, in whatever form."""
    rows = log_rows()[:2500]
    log = stiction.load_log(TABLES[case](tmp_path / "log.csv", rows))
    ((name, signals),) = log.joints.items()
    setup = log.setup_of(name)
    scale = setup.position_scale or 1.0
    assert name == "j" and len(log.time) == len(rows)
    np.testing.assert_allclose(log.time - log.time[0], rows[:, 0], atol=2e-6)
    np.testing.assert_allclose(np.diff(scale * signals.position), np.diff(rows[:, 1]), atol=1e-7)
    np.testing.assert_allclose(scale * (signals.target - signals.position), rows[:, 2] - rows[:, 1], atol=1e-6)
    np.testing.assert_allclose((setup.torque_scale or 1.0) * signals.torque, rows[:, 3], atol=1e-6)


def replaced(rows: np.ndarray, which: np.ndarray, values: Any, columns: tuple[int, ...] = (1,)) -> np.ndarray:
    """Return rows of which some have other values in some columns; the joint is at 0.8 rad and more."""
    copy = rows + np.array([0, 1.5, 1.5, 0])
    copy[np.ix_(which, columns)] = values
    return copy


LEFT_OUT: dict[str, tuple[Callable[[np.ndarray], np.ndarray], np.ndarray, str]] = {
    "zeros among positions": (
        lambda r: replaced(r, np.arange(10, 2500, 97), 0.0),
        np.arange(10, 2500, 97),
        "position of zero far from",
    ),
    "rows of zeros": (
        lambda r: replaced(r, np.arange(10, 2500, 97), 0.0, (1, 2, 3)),
        np.arange(10, 2500, 97),
        "position of zero",
    ),
    "zeros at the start": (lambda r: replaced(r, np.arange(3), 0.0, (1, 2, 3)), np.arange(3), "first sample 1:"),
    "a spike": (lambda r: replaced(r, np.array([900]), 4.0), np.array([900]), "jumps there and back, first sample 901"),
    "stuck at the end": (
        lambda r: replaced(r, np.arange(2000, 2500), r[1999, [1, 3]] + (1.5, 0), (1, 3)),
        np.arange(2000, 2500),
        "500 samples repeat the reading before them to the last digit, first at 4 s",
    ),
    "before the controller starts": (
        lambda r: replaced(r, np.arange(400), (1.5 + r[400, 1], 0.0, 0.0), (1, 2, 3)),
        np.arange(400),
        "400 samples repeat",
    ),
    "nan": (lambda r: replaced(r, np.arange(5, 2500, 400), np.nan), np.arange(5, 2500, 400), "have empty cells"),
}


@pytest.mark.parametrize("case", LEFT_OUT)
def test_rows_without_a_reading_are_left_out_and_said(tmp_path: Path, case: str) -> None:
    """Leaves out exactly the rows that were no readings."""
    made, gone, note = LEFT_OUT[case]
    rows = log_rows()[:2500]
    log = stiction.load_log(table(tmp_path / "log.csv", made(rows)))
    np.testing.assert_allclose(log.time, np.delete(rows[:, 0], gone), atol=1e-9)
    assert note in " ".join(log.notes)


def test_a_joint_at_rest_in_a_simulation_keeps_its_rows(tmp_path: Path) -> None:
    """A simulated joint at rest repeats position and torque to the last digit, and rest tells static friction."""
    rows = simulate()[:25000:10].copy()
    rows[1000:1500, 1:] = rows[1000, 1:]
    assert len(stiction.load_log(table(tmp_path / "log.csv", rows, form="%.17g")).time) == len(rows)


REFUSED: dict[str, tuple[Callable[[Path, np.ndarray], Path], str]] = {
    "a title too many": (titled(f"{TITLES},temperature"), "the header names 5 columns, and most rows have 4 values"),
    "torque twice": (
        lambda path, rows: table(path, np.column_stack([rows, rows[:, 3]]), f"{TITLES},torque.j"),
        "the header names 'torque.j' twice",
    ),
    "s or ms": (titled(TITLES, (1250.5, 1, 1, 1)), "--time-scale 1e-3 where they are ms"),
    "bursts": (
        lambda path, rows: table(path, column(rows, 0, rows[np.arange(len(rows)) // 20 * 20, 0] + BURST[: len(rows)])),
        "come in bursts, .* take that column out and give --rate",
    ),
    "two clocks": (
        lambda path, rows: table(path, column(rows, 0, rows[:, 0] + 5.0 * (np.arange(len(rows)) // 5 % 2))),
        "rows of several logs or clocks are mixed; keep those of one",
    ),
    "short": (
        lambda path, rows: table(path, rows[:150]),
        "150 samples .* log for 0.4 s or more .* or give several runs",
    ),
    "gaps throughout": (
        lambda path, rows: table(path, rows[np.arange(len(rows)) % 100 < 12]),
        "cannot be used: log without gaps",
    ),
}

BURST = np.tile(np.arange(20) * 2e-5, 400)


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_used_is_told_what_to_do(tmp_path: Path, case: str) -> None:
    """The error names the fault of the log and the remedy in one sentence."""
    made, message = REFUSED[case]
    with pytest.raises(StictionError, match=message) as caught:
        stiction.identify(made(tmp_path / "log.csv", log_rows()), **DECLARED)
    assert "\n" not in str(caught.value)


def test_short_runs_are_pooled() -> None:
    """Six runs of 150 samples at 125 Hz, none of which could be used alone, give the friction together."""
    rows = log_rows()[::4]
    logs = [
        stiction.from_arrays(time=t - t[0], position={"j": q}, target={"j": a}, torque={"j": u})
        for t, q, a, u in (rows[i * 150 : (i + 1) * 150].T for i in range(6))
    ]
    result = stiction.identify(*logs, **DECLARED)
    assert result["j"].coulomb_friction.value == pytest.approx(FRICTION, rel=0.03)
    with pytest.raises(LogError, match="150 samples"):
        stiction.identify(logs[0], **DECLARED)
