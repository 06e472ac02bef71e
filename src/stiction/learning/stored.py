"""Configuration of a training as a file holds it, perhaps one of an older version."""

from __future__ import annotations

from typing import Any

from stiction.core.decode import from_plain
from stiction.core.errors import FileError
from stiction.files.method import find_method
from stiction.learning.config import TrainCfg
from stiction.task.config import TaskCfg

FORMER_GROUPS = ("dreamwaq", "hinf")
"""Groups of settings in older config.json, by method; without effect in a run of another method."""


FORMER_SCHEDULE = {"pretraining": "begin", "steps": "stages"}
"""Former name of a setting of friction -> its name; each was written for every method, and used by two."""


def _renamed(task: Any) -> Any:
    """Return the settings of a task, perhaps an older version's, by their names."""
    friction = task.get("friction") if isinstance(task, dict) else None
    if not isinstance(friction, dict) or not FORMER_SCHEDULE.keys() & friction.keys():
        return task
    method = find_method(str(friction.get("method", "deception")))
    used = {"begin": method.begin > 0, "stages": method.stages > 1}
    former = {str(FORMER_SCHEDULE.get(name, name)): value for name, value in friction.items()}
    return task | {"friction": {name: value for name, value in former.items() if used.get(name, True)}}


def config_from(data: Any, where: str) -> TrainCfg:
    """Return the configuration in plain data, perhaps an older version's. Raises `StictionError`; where: its file."""
    if not isinstance(data, dict):
        raise FileError(f"{where} is {str(data)[:60]}; expected the fields of TrainCfg")
    plain = {name: value for name, value in data.items() if name not in (*FORMER_GROUPS, "method_settings")}
    task = from_plain(TaskCfg, _renamed(plain.get("task", {})), f"{where}: task")
    name, kind = task.friction.method, find_method(task.friction.method).settings
    settings = data.get("method_settings", data.get(name) if name in FORMER_GROUPS else None)
    if settings is not None and kind is not None:
        settings = from_plain(kind, settings, f"{where}: {name}")
    return from_plain(TrainCfg, plain | {"task": task, "method_settings": settings}, where)
