"""Process of the policy: wakes at every control period, reads the newest sensors, answers with targets.

It has no way to the robot. If it hangs, fails or is killed, the supervisor damps the robot. Started as a module:

    python -m stiction.deploy.runtime.policy_process BUNDLE SOCKET DIGEST FAULTS
"""

from __future__ import annotations

import gc
import socket
import sys
import time

import numpy as np

from stiction.core.errors import StictionError
from stiction.core.lifeline import follow_parent
from stiction.core.provenance import limit_library_threads
from stiction.deploy.control import ControlLoop
from stiction.deploy.observation import Sensors
from stiction.deploy.policy import Network, Policy, PolicyStep
from stiction.deploy.runtime.channel import IDLE, RUNNING, SENSORS, Channel, sight_layout, targets_layout
from stiction.deploy.runtime.ticker import Ticker
from stiction.deploy.transports.messages import Message
from stiction.deploy.wear import WearMonitor
from stiction.files.bundle import Bundle, reread_bundle

WARM_UP = 50
"""Number of steps over recorded sensors before the first real one, so that all code and memory is ready by then."""

FAULTS = ("none", "policy-exception", "policy-nan", "policy-hang", "policy-exit")
"""Faults that a test can inject, by their number in a message; obeyed only where the process was started for it."""


class PolicyProcess:
    """A bundle's policy at one end of a channel."""

    def __init__(self, bundle: Bundle, channel: Channel, faults: bool = False) -> None:
        """Load the policy and warm it up; faults: True to obey injected faults."""
        contract = bundle.contract
        self._channel, self._faults = channel, faults
        network = Network(bundle.policy, contract.observation.size, contract.num_joints, contract.estimates_velocity)
        self._loop, self._twin = (ControlLoop(Policy(contract, network), contract) for _ in range(2))
        self._wear = None if bundle.wear is None else WearMonitor(contract, bundle.wear)
        self._estimated = np.array((False,) if bundle.wear is None else bundle.wear.estimated[:-1])
        self._sights, self._newest = sight_layout(contract.num_joints), contract.observation.newest()
        self._running, self._sent = False, 0.0
        self._estimate: dict[str, object] = {}
        self._seen: Message | None = None
        self._taken: Message | None = None
        """Newest message that a rehearsal took out of the channel."""
        _warm_up(self._loop, bundle)

    def rehearse(self) -> None:
        """Take what has come, compute a whole step from the last message and forget it.

        The next step then reads only what came since, and finds code and weights in the cache. A policy that runs
        every 20 ms and sleeps in between is several times slower without. The twin has the policy's network, and a
        history, a last action and limits of its own: no target depends on a rehearsal.
        """
        self._taken = self._channel.newest() or self._taken
        if self._running and self._seen is not None:
            self._answer(self._twin, self._sights.vectors(self._seen))

    def step(self, lateness: float, skipped: int) -> bool:
        """Process the newest sensor message and send targets; return False where the supervisor is gone.

        lateness: time behind the deadline [s]; skipped: number of missed deadlines.
        """
        begin = time.monotonic()
        newest, self._taken = self._channel.newest() or self._taken, None
        read = time.monotonic()
        times = {"lateness": lateness, "read": read - begin, "skipped": skipped, "send": self._sent}
        answer: dict[str, object] = {"mode": IDLE, "failed": 0.0}
        step = None
        if newest is not None and (inputs := self._sights.vectors(newest))["mode"][0] == RUNNING:
            step, answer = self._act(inputs)
            self._seen = newest
        elif newest is not None:
            self._running = False
        done = time.monotonic()
        times |= {"step": done - read, "latency": done - begin}
        # The targets first: the estimate of wear below must not delay them.
        alive = self._channel.send(done, answer | times)
        self._sent = time.monotonic() - done
        if step is not None:
            self._watch(step)
        return alive

    def _watch(self, step: PolicyStep) -> None:
        """Estimate wear between two steps: the estimate goes out with the next answer."""
        if self._wear is None or (estimate := self._wear.step(step.observation)) is None:
            return
        low, high = np.where(self._estimated, estimate.interval95, np.nan)
        value = np.where(self._estimated, estimate.friction, np.nan)
        self._estimate = {"wear": value, "wear_low": low, "wear_high": high, "unusual": float(estimate.unusual)}

    def _act(self, inputs: dict[str, np.ndarray]) -> tuple[PolicyStep, dict[str, object]]:
        if not self._running:
            self._loop.reset()
            if self._wear is not None:
                self._wear.reset()
            self._running, self._estimate = True, {}
        fault = FAULTS[int(inputs["fault"][0])] if self._faults else "none"
        if fault == "policy-hang":
            time.sleep(3600.0)
        if fault == "policy-exit":
            raise SystemExit(3)
        if fault == "policy-exception":
            raise RuntimeError("injected")
        step, answer = self._answer(self._loop, inputs)
        if fault == "policy-nan":
            answer["target"] = np.full_like(step.target, np.nan)
        return step, answer | self._estimate

    def _answer(self, loop: ControlLoop, inputs: dict[str, np.ndarray]) -> tuple[PolicyStep, dict[str, object]]:
        step = loop.act(Sensors(*(inputs[name] for name in SENSORS)), inputs["velocity"])
        answer = {"mode": RUNNING, "failed": 0.0, "target": step.target, "action": step.action}
        answer |= {"frame": step.observation[self._newest]}
        return step, answer | {"requested": loop.requested, "limited_by": loop.limited.by}


def _warm_up(loop: ControlLoop, bundle: Bundle) -> None:
    golden = bundle.golden
    for t in range(min(WARM_UP, len(golden))):
        sensors = Sensors(*(getattr(golden, name)[t] for name in SENSORS))
        loop.act(sensors, golden.command[t])
    loop.reset()


def main(path: str, number: str, digest: str, faults: str) -> int:
    """Run until the supervisor is gone; return the exit status."""
    follow_parent()
    limit_library_threads()
    try:
        bundle = reread_bundle(path, digest)
    except StictionError as error:
        print(error, file=sys.stderr)
        return 1
    contract = bundle.contract
    layouts = targets_layout(contract), sight_layout(contract.num_joints)
    channel = Channel(socket.socket(fileno=int(number)), *layouts)
    process = PolicyProcess(bundle, channel, faults == "1")
    # As in the supervisor: a collection of all that was loaded could miss a deadline.
    gc.collect()
    gc.freeze()
    ticker = Ticker(contract.control_period)
    while True:
        try:
            lateness, skipped = ticker.wait(process.rehearse)
            if not process.step(lateness, skipped):
                return 0
        except Exception as error:  # whatever it is, the robot is damped and a person reads one line
            print(f"{type(error).__name__}: {' '.join(str(error).split())}", file=sys.stderr)
            channel.send(time.monotonic(), {"mode": RUNNING, "failed": 1.0})
            return 1


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:5]))
