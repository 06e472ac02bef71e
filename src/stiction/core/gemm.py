"""Opt-in fast kernels of the linear algebra inside torch on processors that are not Intel's; only `train` loads them.

The MKL inside torch calls `mkl_serv_intel_cpu_true` before it chooses kernels by the processor's instructions. If it
returns 0, MKL takes float32 kernels of as little as half the speed, whatever its documented variables say. A library of
4 KiB that returns 1 is therefore made in memory and loaded before torch. A file that appears in no directory is
unusual, so it is loaded only on request (`STICTION_FAST_GEMM=1`). Kernels are still chosen by the instructions that the
processor reports. Rounding differs from that of the slow kernels, so a result records which were active.
"""

from __future__ import annotations

import ctypes
import os
import platform
import re
import struct
import sys
from pathlib import Path

VARIABLE = "STICTION_FAST_GEMM"
"""Environment variable: 1 requests the fast path; unset or anything else leaves the linear algebra unchanged."""

SYMBOL = "mkl_serv_intel_cpu_true"
"""Function that MKL calls to recognise an Intel processor."""

YES = bytes.fromhex("b801000000c3")
"""mov eax, 1; ret."""

_opened: list[ctypes.CDLL] = []


def fast_gemm_obstacle() -> str | None:
    """Return why the fast path is not opened here, or None."""
    return processor_obstacle() or (None if _requested() else f"{VARIABLE} is not 1")


def _requested() -> bool:
    return os.environ.get(VARIABLE, "").strip() == "1"


def processor_obstacle(cpuinfo: Path = Path("/proc/cpuinfo")) -> str | None:
    """Return why the fast path has no benefit on this machine, or None."""
    if platform.system() != "Linux" or platform.machine() != "x86_64":
        return f"nothing to do on {platform.system()} {platform.machine()}"
    try:
        text = cpuinfo.read_text()
    except OSError:
        return "the processor is not known"
    vendor = re.search(r"^vendor_id\s*:\s*(\S+)$", text, re.MULTILINE)
    flags = re.search(r"^flags\s*:(.*)$", text, re.MULTILINE)
    if vendor is None or vendor.group(1) == "GenuineIntel":
        return "nothing to do on this processor"
    if flags is None or not {"avx2", "fma"} <= set(flags.group(1).split()):
        return "the processor lacks AVX2"
    return None


def open_fast_gemm() -> None:
    """Load the fast kernels on request, if the processor has them. No effect once torch is loaded."""
    if _opened or "torch" in sys.modules or fast_gemm_obstacle() is not None:
        return
    try:
        file = os.memfd_create("stiction-gemm")
        try:
            os.write(file, yes_library())
            # Globally, and before torch: of libraries that have the same symbol, the loader takes the first.
            _opened.append(ctypes.CDLL(f"/proc/self/fd/{file}", mode=ctypes.RTLD_GLOBAL))
        finally:
            os.close(file)
    except OSError:
        return


def gemm_path() -> str:
    """Return the kind of matrix products in this process: `fast`, or `default` with the reason."""
    if _opened:
        return "fast"
    why = fast_gemm_obstacle()
    if why is None:
        why = "torch was loaded first" if "torch" in sys.modules else "not opened"
    return f"default ({why})"


def fast_gemm_note() -> str | None:
    """Return one line for the user of `train`: the gain of the fast path, or why a request has no effect; or None."""
    if _opened:
        return None
    if _requested():
        why = gemm_path().removeprefix("default (").removesuffix(")")
        return f"{VARIABLE}=1 has no effect: {why}"
    if processor_obstacle() is not None:
        return None
    return (
        f"{VARIABLE}=1 makes updates of the networks about 1.1 to 1.7 times faster on this processor, by a library "
        "made in memory (SECURITY.md); numbers differ by rounding"
    )


def yes_library() -> bytes:
    """Return an ELF library for x86-64 with one function, `SYMBOL`, that returns 1."""
    # One page for all that is only read or run, the next for the dynamic section, which the loader writes into.
    symbols, strings, table, code, dynamic = 0x120, 0x150, 0x170, 0x190, 0x1000
    names = b"\0" + SYMBOL.encode() + b"\0"
    # Of hash table, strings, symbols, sizes of both, and the end: without a hash table no symbol is found.
    tags = ((4, table), (5, strings), (6, symbols), (10, len(names)), (11, 24), (0, 0))
    entries = b"".join(struct.pack("<QQ", *tag) for tag in tags)
    # Type, flags, offset, size, alignment of: headers, symbols, code; what is written; dynamic section; stack.
    segments = (
        (1, 5, 0, code + len(YES), 0x1000),
        (1, 6, dynamic, len(entries), 0x1000),
        (2, 6, dynamic, len(entries), 8),
        # Without a header for the stack the loader assumes that the library wants an executable one.
        (0x6474E551, 6, 0, 0, 16),
    )
    parts = {
        0: struct.pack("<16sHHIQQQIHHHHHH", b"\x7fELF\x02\x01\x01", 3, 62, 1, 0, 64, 0, 0, 64, 56, 4, 0, 0, 0),
        64: b"".join(
            struct.pack("<IIQQQQQQ", kind, may, at, at, at, n, n, step) for kind, may, at, n, step in segments
        ),
        # Symbol 0 is none, by definition. A global function; its section may be any but 0, which is: not defined here.
        symbols: bytes(24) + struct.pack("<IBBHQQ", 1, 0x12, 0, 1, code, len(YES)),
        strings: names,
        # One bucket, with symbol 1 in it, for whatever name is looked up.
        table: struct.pack("<5I", 1, 2, 1, 0, 0),
        code: YES,
        dynamic: entries,
    }
    image = bytearray(dynamic + len(entries))
    for start, part in parts.items():
        image[start : start + len(part)] = part
    return bytes(image)
