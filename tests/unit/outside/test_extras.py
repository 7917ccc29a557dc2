"""What is asked for before a format or a part runs is what its extra installs."""

from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, packages_distributions, requires
from typing import Any

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from ros2_kafka_bridge.outside import extras
from ros2_kafka_bridge.outside.extras import missing_extra


@pytest.mark.parametrize('extra', extras._NEEDED)
def test_an_extra_installs_all_that_is_asked_for(
    extra: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[str] = []

    def find(module: str) -> Any:
        asked.append(module)
        return module

    monkeypatch.setattr('ros2_kafka_bridge.outside.extras.find_spec', find)
    assert missing_extra(extra) is None
    brought = set(all_of(Requirement(f'ros2-kafka-bridge[{extra}]'), set()))
    makers = packages_distributions()
    of_whom = {m: {canonicalize_name(d) for d in makers[m.partition('.')[0]]} for m in asked}
    assert of_whom
    assert [module for module, names in of_whom.items() if not names & brought] == []


def all_of(wanted: Requirement, seen: set[str]) -> Iterator[str]:
    """The distributions that a requirement brings, however indirectly."""
    seen.add(str(wanted))
    yield canonicalize_name(wanted.name)
    try:
        needs = [Requirement(text) for text in requires(wanted.name) or ()]
    except PackageNotFoundError:  # for another platform
        return
    for need in needs:
        told = [{'extra': name} for name in ('', *wanted.extras)]
        applies = need.marker is None or any(need.marker.evaluate(extra) for extra in told)
        need.marker = None
        if applies and str(need) not in seen:
            yield from all_of(need, seen)
