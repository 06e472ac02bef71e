"""Memory: what is counted, what the system holds, and what want of it says."""

from __future__ import annotations

import errno
import resource
import sys

import pytest

from stiction.core.errors import LogError, StictionError
from stiction.core.memory import DEFAULT_LIMIT, allowance, check_ratio, claim, limit_memory


def test_a_table_may_take_a_quarter() -> None:
    """The limit holds inside, and no longer than that."""
    assert allowance() == DEFAULT_LIMIT // 4
    with limit_memory(2**32):
        assert allowance() == 2**30
        claim("x", 2**30, "it takes", LogError)
        with pytest.raises(LogError, match=r"x: it takes 1073741825 bytes; at most 1073741824 are read"):
            claim("x", 2**30 + 1, "it takes", LogError)
    assert allowance() == DEFAULT_LIMIT // 4


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere the system does not say how much a process has")
def test_the_system_holds_the_rest_and_lets_go() -> None:
    """Ends uncounted allocations in one line, and restores the process's limit."""
    before = resource.getrlimit(resource.RLIMIT_AS)
    message = r"not enough memory: this takes more than 0.25 GiB.*--memory-limit"
    with pytest.raises(StictionError, match=message), limit_memory(2**28):
        bytearray(2**29)
    assert resource.getrlimit(resource.RLIMIT_AS) == before
    assert len(bytearray(2**20)) == 2**20


def test_other_errors_pass() -> None:
    """A full disk is no want of memory."""
    with pytest.raises(OSError, match="full"), limit_memory(2**30):
        raise OSError(errno.ENOSPC, "full")
    with pytest.raises(StictionError, match="not enough memory"), limit_memory(2**30):
        raise OSError(errno.ENOMEM, "none")


def test_what_shrinks_too_far_was_never_measured() -> None:
    """Two hundred to one, and nothing below 16 MiB."""
    check_ratio("x", 10, 2**24, LogError)
    check_ratio("x", 2**20, 200 * 2**20, LogError)
    with pytest.raises(LogError, match="which no log does"):
        check_ratio("x", 2**20, 200 * 2**20 + 1, LogError)
