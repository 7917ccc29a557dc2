"""What another process of a bridge gets of a configuration that was checked."""

import json
from dataclasses import fields
from pathlib import Path
from typing import get_args, get_type_hints

import pytest

from ros2_kafka_bridge.config.base import Settings
from ros2_kafka_bridge.config.file import loads
from ros2_kafka_bridge.config.settings import (
    Config,
    KafkaToRosRoute,
    RosSettings,
    RosToKafkaRoute,
    Route,
    restored,
)
from ros2_kafka_bridge.config.validation import plain

FILES = Path(__file__).parent / 'files'
ENVIRON = {'BROKERS': 'broker:9093', 'PASSWORD': 'x', 'DOMAIN': '7'}


def test_every_kind_of_a_setting_is_one_that_can_be_passed_on() -> None:
    """`restored` knows plain values, one settings class or none, paths, and the routes."""
    models = [*Settings.__subclasses__(), *Route.__subclasses__()]
    nested = {
        (model, name): kind
        for model in models
        for name, kind in get_type_hints(model).items()
        if name in {field.name for field in fields(model)}
        if 'ros2_kafka_bridge' in str(kind) or 'Path' in str(kind)
    }
    assert nested.pop((Config, 'routes')) == list[KafkaToRosRoute | RosToKafkaRoute]
    assert nested.pop((RosSettings, 'message_path')) == list[Path]
    for kind in nested.values():
        left = {kind, *get_args(kind)} - {type(None), *models, *(model | None for model in models)}
        assert not left


@pytest.mark.parametrize('file', sorted(FILES.glob('good_*.yaml')), ids=lambda path: path.stem)
def test_a_process_that_runs_routes_has_the_configuration_that_another_has_read(
    file: Path,
) -> None:
    config = loads(file.read_text('utf-8'), str(file), ENVIRON)
    passed_on = json.loads(json.dumps(plain(config)))
    assert restored(passed_on) == config
