"""All joints of a log, side by side on the machine's cores; a joint that cannot be identified does not stop others."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from dataclasses import replace
from multiprocessing import get_context

from stiction.formats.errors import StictionError
from stiction.formats.joints import JointRecord
from stiction.formats.log import Log
from stiction.formats.reproducibility import num_threads
from stiction.identify.pipeline import Identification, identify_joint
from stiction.identify.setup import IdentifySetup

Done = Callable[[str], None]
"""Called with a joint's name when it is identified."""

REFUSED = "not identified: "
"""How the warning of a refused joint begins."""


def identify_log(
    log: Log,
    setup: IdentifySetup | None = None,
    joints: Sequence[str] = (),
    repeats: Sequence[Log] = (),
    done: Done = lambda name: None,
    workers: int | None = None,
) -> tuple[dict[str, Identification], dict[str, JointRecord]]:
    """Identify several joints, every one of the log's by default.

    Returns the joints that were identified, and for those that were refused an empty record whose warning says why,
    both in the order of the log, or of `joints`. `workers`: processes, by default one a core. Raises `StictionError`
    where a joint is not in the log, or none could be identified.
    """
    names = [log.joint(name)[0] for name in joints] or list(log.joints)
    found: dict[str, Identification] = {}
    refused: dict[str, str] = {}
    # Of several joints each is asked for by name, or a repeat that lacks it could offer its only joint instead.
    named = bool(joints) or len(log.joints) > 1
    jobs = {
        name: (_alone(log, name), name if named else None, setup, tuple(_alone(one, name) for one in repeats))
        for name in names
    }
    for name, outcome in _outcomes(jobs, min(len(jobs), workers or num_threads())):
        if isinstance(outcome, StictionError):
            refused[name] = str(outcome)
        else:
            found[name] = outcome
            done(name)
    if not found:
        raise StictionError(refused[names[0]])
    empty = {name: JointRecord(warnings=(REFUSED + refused[name],)) for name in names if name in refused}
    return {name: found[name] for name in names if name in found}, empty


def _outcomes(jobs: Mapping[str, _Job], workers: int) -> Iterator[tuple[str, Identification | StictionError]]:
    """Yield each joint's name with its identification or its refusal, as they are finished."""
    if workers == 1:
        for name, job in jobs.items():
            yield name, _attempt(*job)
        return
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        waiting: dict[Future, str] = {pool.submit(_attempt, *job): name for name, job in jobs.items()}
        try:
            for future in as_completed(waiting):
                yield waiting[future], future.result()
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


_Job = tuple[Log, str | None, IdentifySetup | None, tuple[Log, ...]]
"""What `_attempt` is called with."""


def _alone(log: Log, name: str) -> Log:
    """Return the log with one joint: a worker needs no more. A repeat without the joint stays whole, and is refused."""
    return replace(log, joints={name: log.joints[name]}) if name in log.joints else log


def _attempt(
    log: Log, name: str | None, setup: IdentifySetup | None, repeats: Sequence[Log]
) -> Identification | StictionError:
    """Identify one joint; what is wrong with it comes back as a value, for an exception would lose its class."""
    try:
        return identify_joint(log, name, setup, repeats)
    except StictionError as error:
        return error
