"""Unitree's topics over DDS on loopback: the maker's types, a robot in a process of its own, the maker's library."""

from __future__ import annotations

import json
import os
import select
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from bundles import make_bundle, make_contract
from processes import wait_until
from stiction.cli.main import main
from stiction.core.errors import ConfigurationError
from stiction.deploy.runtime import config
from stiction.deploy.runtime.config import SupervisorCfg
from stiction.deploy.transports.dds import DdsBus, domain_settings, wire_type
from stiction.files.unitree import GO_COMMAND, GO_STATE, HG_COMMAND, HG_STATE, STRUCTURES, Structure
from stiction.robots.catalog import find_robot

pytest.importorskip("cyclonedds", reason="the package cyclonedds, of the extra 'unitree', is not installed")

PATIENT = ("--stale", "5", "--silence", "5", "--gap", "5", "--set", "safety.losses=1")

ROBOT = Path(__file__).parents[1] / "helpers/unitree_robot.py"

IDENTITIES = {
    GO_COMMAND.kind: "832876ceec9737d69f6ed62a3f63 52cc8eb0d427d692aa2b20a90540",
    GO_STATE.kind: "853a99e23d0daa1610b65c526b40 08f239c471d3a27e67e7c7723184",
    HG_COMMAND.kind: "6569fc15f0d47aa8600b9e91fbbc 42b0283aa7e1bb592ec898a0dbed",
    HG_STATE.kind: "2f38296b52aa0230b92d378b1e39 2be9706c9587e8d8afd8bfc6de7b",
}
"""Hashes of the types, minimal and complete, as far-unitree-sdk 0.1.8 announces them: the maker's definitions."""


@pytest.fixture
def domain() -> int:
    """A domain of this test's process: tests beside it speak on the same loopback."""
    return 1 + os.getpid() % 200


@contextmanager
def robot(family: str, domain: int, mode: str = "plain") -> Iterator[subprocess.Popen[str]]:
    """A robot in a process of its own."""
    words = [sys.executable, str(ROBOT), family, str(domain), mode]
    process = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None and process.stdout.readline() == "ready\n"
        yield process
    finally:
        process.kill()
        process.communicate()


def deploy(folder: Path, domain: int, transport: str, spec: str, seconds: float) -> list[str]:
    """Return the command that deploys a toy policy of a robot over loopback."""
    bundle = make_bundle(folder / "toy", make_contract(spec, anatomy=find_robot(spec)))
    words = ["deploy", str(bundle), "--robot", f"{transport}:lo", "--armed", "--duration", str(seconds), "--json"]
    return [*words, "--domain", str(domain), "--out", str(folder / "run"), *PATIENT]


@pytest.mark.parametrize("kind", IDENTITIES)
def test_types_are_the_maker_s_to_the_last_field(kind: str) -> None:
    """Another name, order or width of a field makes another type: nothing arrives, or an old robot's DDS goes down."""
    made = wire_type(STRUCTURES[kind])
    made.__idl__.fill_type_data()
    info = made.__idl__.get_type_info()
    identities = [bytes(part.typeid_with_size.type_id.value).hex() for part in (info.minimal, info.complete)]
    assert " ".join(identities) == IDENTITIES[kind]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("family", "spec", "mode"),
    [("unitree_go", "go1", "plain"), ("unitree_go", "go2", "checked"), ("unitree_hg", "g1", "plain")],
)
def test_a_run_from_damping_to_damping(
    tmp_path: Path, domain: int, family: str, spec: str, mode: str, capfd: pytest.CaptureFixture
) -> None:
    """Standing up, policy and damping reach a robot whose messages another program writes and reads."""
    words = [*deploy(tmp_path, domain, family.replace("_", "-"), spec, 0.5), "--held.kp", "40", "--held.kd", "2"]
    with robot(family, domain, mode) as process:
        assert main(words) == 0, capfd.readouterr().err
        heard = json.loads(process.communicate("")[0])
    report = json.loads(capfd.readouterr().out)
    assert report["malformed"] == 0 and report["states"] > 100 and report["periods"] > 5
    assert len(heard) > 50 and all(one["crc"] and one["on"] and one["damped"] and not one["others"] for one in heard)
    stiff = [one["stiff"] for one in heard]
    first, last = stiff.index(True), len(stiff) - stiff[::-1].index(True)
    assert all(stiff[first:last]) and not any(stiff[last:]) and last < len(stiff)
    # What it is asked first is near where it was, also on a machine that misses some commands; elbows are held at 1.28.
    pose = [0.0, 0.9, -1.8] * 4 if family == "unitree_go" else [0.0] * 29
    np.testing.assert_allclose(heard[first]["q"], pose, atol=0.5)
    assert {one["mode_machine"] for one in heard} == ({None} if family == "unitree_go" else {5})


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="processes are looked for in /proc, which only Linux has")
def test_the_watchdog_damps_over_dds_too(tmp_path: Path, domain: int) -> None:
    """After kill -9 of the supervisor another process writes damping frames with right checksums."""
    words = [sys.executable, "-m", "stiction", *deploy(tmp_path, domain, "unitree-go", "go1", 60)]
    with robot("unitree_go", domain) as process:
        with subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as run:
            wait_until(lambda: len(list((tmp_path / "run/log").glob("readings-*.npz"))) >= 3, "no log came", 120.0)
            run.kill()
            line = run.communicate()[1].splitlines()[-1]
        heard = json.loads(process.communicate("")[0])
    assert "the supervisor was silent; the watchdog damped the robot for" in line
    stiff = [one["stiff"] for one in heard]
    after = heard[len(stiff) - stiff[::-1].index(True) :]
    assert len(after) > 20 and all(one["damped"] and one["on"] and one["crc"] for one in after)


@dataclass(frozen=True)
class Hasty(SupervisorCfg):
    """A supervisor that waits for the robot no longer than a test does."""

    ready_timeout: float = 3.0


def test_states_without_a_checksum_are_refused_once_in_words_and_in_the_report(
    tmp_path: Path, domain: int, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture
) -> None:
    """The maker's simulator in Python leaves it at zero: one line says so, and --json holds it."""
    monkeypatch.setattr(config, "SupervisorCfg", Hasty)
    words = [*deploy(tmp_path, domain, "unitree-go", "go2", 9), "--keep-minutes", "0"]
    with robot("unitree_go", domain, "simulator") as process:
        assert main(words) == 1
        assert json.loads(process.communicate("")[0]) == []
    output, errors = capfd.readouterr()
    report = json.loads(output)
    assert report["stop"]["rule"] == "not ready" and report["malformed"] > 10 and report["states"] == 0
    assert report["complaint"].startswith("checksum: got 0, expected ")
    assert errors.count("\n") == 1 and errors.count(report["complaint"]) == 1


def test_a_gait_controller_that_still_commands_ends_the_run(
    tmp_path: Path, domain: int, capfd: pytest.CaptureFixture
) -> None:
    """The maker's own controller and ours pull at the same motors."""
    words = [*deploy(tmp_path, domain, "unitree-go", "go1", 9), "--keep-minutes", "0"]
    with robot("unitree_go", domain, "foreign"):
        assert main(words) == 1
    assert json.loads(capfd.readouterr().out)["stop"]["rule"] == "second writer"


def test_two_robots_on_one_domain_are_refused_before_anything_moves(
    tmp_path: Path, domain: int, capfd: pytest.CaptureFixture
) -> None:
    """One run does not move two robots: neither hears a stiff command, and both are named."""
    words = [*deploy(tmp_path, domain, "unitree-go", "go1", 9), "--keep-minutes", "0"]
    with robot("unitree_go", domain) as first, robot("unitree_go", domain) as second:
        assert main([*words, "--readers", "2"]) == 1
        heard = [json.loads(each.communicate("")[0]) for each in (first, second)]
        error = capfd.readouterr().err
        assert error.startswith("stiction deploy: second robot: got 2 (") and error.count("\n") == 1
        assert all(f"process {each.pid} on " in error for each in (first, second))
        assert not any(one["stiff"] for each in heard for one in each)


FAR = """
import json, sys, time
import unitree_interface as far
family, settings = sys.argv[1:]
make = far.UnitreeInterface.create_go2 if family == "go" else far.UnitreeInterface.create_g1
robot = make("lo", dds_config=settings)
state = far.LowState(robot.get_num_motors())
state.motor.q, state.imu.quat, state.mode_machine = [0.5 + i for i in range(robot.get_num_motors())], [1, 0, 0, 0], 5
until = time.time() + 60
while time.time() < until:
    robot.publish_low_state(state)
    heard = robot.read_incoming_command()
    if any(heard.kp):
        values = heard.q_target, heard.kp, heard.kd, heard.tau_ff
        print("HEARD " + json.dumps([list(one) for one in values]), flush=True)
        break
    time.sleep(0.005)
"""


@pytest.mark.parametrize(("family", "state", "command"), [("go", GO_STATE, GO_COMMAND), ("hg", HG_STATE, HG_COMMAND)])
def test_the_maker_s_library_understands_us(family: str, state: Structure, command: Structure) -> None:
    """The maker's C++ library accepts our checksum, types and topics."""
    pytest.importorskip(
        "unitree_interface", reason="far-unitree-sdk, with which messages are compared, is not installed"
    )
    words = [sys.executable, "-c", FAR, family, domain_settings("lo")]
    bus = DdsBus("lo", state, command)  # Its domain cannot be chosen: 0, as robots have it.
    process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    message, number, until = command.blank(), 12 if family == "go" else 29, time.monotonic() + 60
    motors = message["motor_cmd"][:number]
    motors["mode"], motors["q"], motors["kp"] = 1, np.arange(number) / 8, 40 + np.arange(number)
    motors["kd"], motors["tau"] = 2 + np.arange(number) / 4, -np.arange(number) / 2
    if family == "go":
        message["head"], message["level_flag"] = (0xFE, 0xEF), 0xFF
    try:
        while process.poll() is None and time.monotonic() < until:
            select.select([bus.fileno()], [], [], 0.1)
            for _, data in bus.receive():
                fields = state.from_wire(data)
                assert state.checksum(fields) == fields["crc"]
                np.testing.assert_allclose(fields["motor_state"]["q"][:number], 0.5 + np.arange(number))
                if family == "hg":
                    message["mode_machine"] = fields["mode_machine"]
                message["crc"] = command.checksum(message)
                bus.send(command.to_wire(message))
        output, errors = process.communicate(timeout=10)
    finally:
        process.kill()
        bus.close()
    lines = [line for line in output.splitlines() if line.startswith("HEARD ")]
    assert lines, output + errors
    for name, values in zip(("q", "kp", "kd", "tau"), json.loads(lines[0].removeprefix("HEARD ")), strict=True):
        np.testing.assert_allclose(values, motors[name], rtol=1e-6, err_msg=name)


def test_only_the_named_interface_is_used(domain: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """An environment variable that names another network sends commands there."""
    monkeypatch.setenv("CYCLONEDDS_URI", "<CycloneDDS><Domain><General><Interfaces><NetworkInterface name='nowhere0'/>")
    bus = DdsBus("lo", GO_STATE, GO_COMMAND, domain)
    assert bus.receive() == [] and not bus.foreign()
    bus.close()
    with pytest.raises(ConfigurationError, match=r"'lo<x/>'.*it has .*lo"):
        DdsBus("lo<x/>", GO_STATE, GO_COMMAND, domain)
    with pytest.raises(ConfigurationError, match="--domain: got 233, expected 0 to 232"):
        DdsBus("lo", GO_STATE, GO_COMMAND, 233)


SECOND = """
import sys, time
from stiction.deploy.transports.dds import DdsBus
from stiction.files.unitree import GO_COMMAND, GO_STATE
bus = DdsBus("lo", GO_STATE, GO_COMMAND, int(sys.argv[1]))
print(bus.writer, flush=True)
until = time.monotonic() + 600
while time.monotonic() < until:
    bus.send(GO_COMMAND.to_wire(GO_COMMAND.blank()))
    time.sleep(0.01)
"""


def test_the_watchdog_is_no_second_writer_and_no_further_reader(domain: int) -> None:
    """Exempts the writer and the reader of the participant that is known, and nobody else's."""
    bus, words = DdsBus("lo", GO_STATE, GO_COMMAND, domain), [sys.executable, "-c", SECOND, str(domain)]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            name = process.stdout.readline().strip()
            wait_until(lambda: bus.foreign() and len(bus.peers().readers) == 1, "the second writer is not heard", 300.0)
            bus.know("somebody else")
            wait_until(lambda: bus.foreign() and len(bus.peers().readers) == 1, "anybody is exempt", 300.0)
            bus.know(name)
            bus.foreign()
            heard = []
            for _ in range(20):
                time.sleep(0.02)
                heard.append(bus.foreign())
            assert not any(heard) and bus.peers().readers == ()
        finally:
            process.kill()
            bus.close()
