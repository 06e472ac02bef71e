"""TensorBoard shows every step of a run once, however often it was resumed."""

from pathlib import Path

from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from stiction.learning.figures import Board


def test_steps_made_again_after_a_resume_are_shown_once(tmp_path: Path) -> None:
    """Curves that go back in time hide what happened."""
    first = Board(tmp_path / "teacher")
    for iteration in (1, 2, 3, 4):
        first.add(iteration, {"reward": float(iteration), "walk/falls": 0.0})
    first.flush()
    first.close()
    # Files of one second are in the order of their names, whose last part counts all writers of the process.
    (file,) = (tmp_path / "teacher").iterdir()
    file.rename(file.with_name("events.out.tfevents.1.before"))
    again = Board(tmp_path / "teacher")
    again.flush()
    for iteration in (3, 4, 5):
        again.add(iteration, {"reward": 10.0 * iteration, "walk/falls": 0.0})
    again.close()
    shown = EventAccumulator(str(tmp_path / "teacher"))
    shown.Reload()
    assert shown.Tags()["scalars"] == ["training/reward", "walk/falls"]
    points = [(event.step, event.value) for event in shown.Scalars("training/reward")]
    assert points == [(1, 1.0), (2, 2.0), (3, 30.0), (4, 40.0), (5, 50.0)]
