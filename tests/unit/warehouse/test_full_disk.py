"""What the warehouse does where nothing can be written."""

import errno
import os
import tempfile
from typing import Never

import pytest

from ros2_kafka_warehouse import run
from ros2_kafka_warehouse.ros_domain import claim_domain
from ros2_kafka_warehouse.run_options import StartError


def test_a_domain_is_claimed_on_a_full_disk_too(monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> Never:
        raise OSError(errno.ENOSPC, 'No space left on device')

    monkeypatch.setattr(os, 'pwrite', full)
    with (
        claim_domain(231),
        pytest.raises(StartError, match='another warehouse'),
        claim_domain(231),
    ):
        pass


def test_without_a_folder_for_logs_the_cure_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, 'tempdir', '/proc/none')
    with pytest.raises(StartError, match='--logs'), run._place(None):
        pass
