"""The fast path of matrix products: who opens it and where, and that it changes no result beyond rounding."""

import json
import os
import platform
import subprocess
import sys
from pathlib import Path

import pytest

from stiction.core import gemm

AMD = "vendor_id\t: AuthenticAMD\nflags\t\t: fpu sse4_2 fma avx2 bmi2\n"


@pytest.fixture
def linux(monkeypatch: pytest.MonkeyPatch) -> None:
    """An x86-64 Linux."""
    monkeypatch.setattr("platform.system", lambda: "Linux")
    monkeypatch.setattr("platform.machine", lambda: "x86_64")


@pytest.mark.usefixtures("linux")
@pytest.mark.parametrize(
    ("cpuinfo", "why"),
    [
        (AMD, None),
        (AMD.replace("AuthenticAMD", "GenuineIntel"), "nothing to do on this processor"),
        (AMD.replace("avx2", "avx"), "the processor lacks AVX2"),
        ("processor\t: 0\n", "nothing to do on this processor"),
        (None, "the processor is not known"),
    ],
)
def test_it_is_opened_only_where_it_helps(tmp_path: Path, cpuinfo: str | None, why: str | None) -> None:
    """Harmless on Intel, and never on a processor whose kernels it would promise too much."""
    file = tmp_path / "cpuinfo"
    if cpuinfo is not None:
        file.write_text(cpuinfo)
    assert gemm.processor_obstacle(file) == why


def test_the_note_of_train(monkeypatch: pytest.MonkeyPatch) -> None:
    """Names the gain where the processor has it and it is off, and the cause where a request has no effect."""
    monkeypatch.setattr(gemm, "_opened", [])
    monkeypatch.delenv(gemm.VARIABLE, raising=False)
    monkeypatch.setattr(gemm, "processor_obstacle", lambda: None)
    assert "STICTION_FAST_GEMM=1 makes updates of the networks about 1.1 to 1.7" in (gemm.fast_gemm_note() or "")
    monkeypatch.setattr(gemm, "processor_obstacle", lambda: "the processor lacks AVX2")
    assert gemm.fast_gemm_note() is None
    monkeypatch.setenv(gemm.VARIABLE, "1")
    assert gemm.fast_gemm_note() == "STICTION_FAST_GEMM=1 has no effect: the processor lacks AVX2"
    monkeypatch.setattr(gemm, "_opened", [object()])
    assert gemm.fast_gemm_note() is None


IN_VERBS = """
import contextlib, io, json, sys
from pathlib import Path
from stiction.cli.main import main
from stiction.core import gemm
gemm.processor_obstacle = lambda: None
path = {}
for words in json.loads(sys.argv[1]):
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        try:
            status = main(words)
        except SystemExit as stop:
            status = stop.code
    loaded = "stiction-gemm" in Path("/proc/self/maps").read_text()
    path[words[0]] = [status, loaded, gemm.gemm_path() == "fast"]
print(json.dumps(path))
"""


def run_verbs(lines: list[list[str]], folder: Path, **environment: str) -> dict[str, list]:
    """Run verbs in one process of their own; return status, library loaded or not, fast path or not, of each."""
    done = subprocess.run(
        [sys.executable, "-c", IN_VERBS, json.dumps(lines)],
        env={**os.environ, "PYTHONPATH": str(Path(gemm.__file__).parents[2]), **environment},
        capture_output=True,
        text=True,
        check=True,
        cwd=folder,
    )
    return dict(json.loads(done.stdout))


linux_only = pytest.mark.skipif(
    (platform.system(), platform.machine()) != ("Linux", "x86_64"), reason="the library is for Linux on x86-64"
)


@linux_only
def test_train_opens_it_where_it_is_asked_to(tmp_path: Path) -> None:
    """Opens the library for a training with the variable, and for no other verb."""
    pytest.importorskip("torch", reason="the verb train needs the extra train")
    seen = run_verbs([["list", "robots"], ["train", "--resume", "missing"]], tmp_path, **{gemm.VARIABLE: "1"})
    assert seen == {"list": [0, False, False], "train": [1, True, True]}


PROBE = """
import ctypes, json, sys
from stiction.core.gemm import gemm_path, open_fast_gemm
from stiction.core.parallel import spread
open_fast_gemm()
workers = [path for _, path in spread(gemm_path, [(), ()], 2)]
import torch
open_fast_gemm()
torch.set_num_threads(1)
torch.manual_seed(0)
net = torch.nn.Sequential(torch.nn.Linear(90, 256), torch.nn.ELU(), torch.nn.Linear(256, 18))
x, y, losses = torch.randn(512, 90), torch.randn(512, 18), []
for _ in range(20):
    loss = (net(x) - y).square().mean()
    gradients = torch.autograd.grad(loss, list(net.parameters()))
    with torch.no_grad():  # by hand: an optimizer of torch would load its compiler first
        for value, gradient in zip(net.parameters(), gradients):
            value -= 0.1 * gradient
    losses.append(loss.item())
answer = getattr(ctypes.CDLL(None), "mkl_serv_intel_cpu_true", None)
print(json.dumps({"path": gemm_path(), "losses": losses, "answer": answer and answer(), "workers": workers}))
"""


def probe(**environment: str) -> dict:
    """Return the results of a training in a separate process."""
    source = str(Path(gemm.__file__).parents[2])
    known = {"OMP_NUM_THREADS": "1", "PYTHONPATH": source} | environment
    done = subprocess.run(
        [sys.executable, "-c", PROBE], env={**os.environ, **known}, capture_output=True, text=True, check=True
    )
    return dict(json.loads(done.stdout))


def test_losses_agree_with_and_without_and_the_switch_switches() -> None:
    """Only rounding may differ: 1e-5 of the loss after each of twenty steps; workers take the parent's path."""
    pytest.importorskip("torch", reason="the package torch, of the extra 'train', multiplies the matrices")
    off, on = probe(**{gemm.VARIABLE: ""}), probe(**{gemm.VARIABLE: "1"})
    assert off["path"] == f"default ({gemm.processor_obstacle() or 'STICTION_FAST_GEMM is not 1'})"
    assert off["answer"] is None
    assert all(outcome["workers"] == [outcome["path"]] * 2 for outcome in (off, on))
    assert on["losses"] == pytest.approx(off["losses"], rel=1e-5)
    assert on["losses"][-1] < on["losses"][0]
    if (why := gemm.processor_obstacle()) is not None:
        pytest.skip(f"the fast path is not opened here: {why}")
    assert on["path"] == "fast" and on["answer"] == 1


def test_a_system_that_refuses_is_left_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    """Some forbid code in memory: training must go on without, and say so."""
    monkeypatch.setattr(gemm, "_opened", [])
    monkeypatch.setattr(gemm, "fast_gemm_obstacle", lambda: None)
    monkeypatch.delitem(sys.modules, "torch", raising=False)

    def refuse(name: str) -> int:
        raise PermissionError(name)

    monkeypatch.setattr(os, "memfd_create", refuse, raising=False)
    gemm.open_fast_gemm()
    assert gemm.gemm_path() == "default (not opened)"
