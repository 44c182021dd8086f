"""Limit of file sizes, which stands for a full disk in tests."""

import contextlib
from collections.abc import Iterator

import pytest


@contextlib.contextmanager
def disk_of(size: int) -> Iterator[None]:
    """Make the operating system refuse to write more than `size` bytes to a file."""
    resource = pytest.importorskip("resource")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
