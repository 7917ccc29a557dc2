"""What a Kafka client said last, kept for the moment when it is given up."""

import json
import logging

import pytest

from ros2_kafka_bridge.kafka.recorder import Recorder, with_recording

FORM = '%s [%s] %s'


def log(name: str) -> logging.LoggerAdapter[logging.Logger]:
    return logging.LoggerAdapter(logging.getLogger(name), {})


def told(caplog: pytest.LogCaptureFixture) -> list[str]:
    return [record.getMessage().partition(' ago: ')[2] for record in caplog.records]


def test_details_are_kept_and_what_is_more_is_passed_on(caplog: pytest.LogCaptureFixture) -> None:
    recorder = Recorder(logging.getLogger('client'))
    recorder.log(logging.DEBUG, FORM, 'FETCH', 'rdkafka#consumer-1', 'Fetch topic t [0]')
    recorder.log(logging.ERROR, FORM, 'FAIL', 'rdkafka#consumer-1', 'Connection refused')
    assert [record.getMessage() for record in caplog.records] == [
        'FAIL [rdkafka#consumer-1] Connection refused'
    ]


def test_a_client_that_is_given_up_has_its_last_lines_told_once_in_their_order(
    caplog: pytest.LogCaptureFixture,
) -> None:
    caplog.set_level(logging.INFO)
    recorder = Recorder(logging.getLogger('client'))
    for kind, text in (('ASSIGN', 'one'), ('FETCH', 'two'), ('ASSIGN', 'three')):
        recorder.log(logging.DEBUG, FORM, kind, 'rdkafka#consumer-1', text)
    recorder.tell(log('route'))
    assert told(caplog) == ['ASSIGN one', 'FETCH two', 'ASSIGN three']
    recorder.tell(log('route'))
    assert len(caplog.records) == 3


def test_many_fetches_of_one_partition_do_not_push_out_the_assignment_of_another(
    caplog: pytest.LogCaptureFixture,
) -> None:
    caplog.set_level(logging.INFO)
    recorder = Recorder(logging.getLogger('client'))
    recorder.log(logging.DEBUG, FORM, 'ASSIGN', 'rdkafka#consumer-1', 'Assigned t [7]')
    recorder.log(logging.DEBUG, FORM, 'DUMP_ALL', 'rdkafka#consumer-1', 'List of 0 partitions')
    for offset in range(100_000):
        recorder.log(logging.DEBUG, FORM, 'FETCH', 'rdkafka#consumer-1', f'at {offset}')
    recorder.tell(log('route'))
    assert told(caplog)[0] == 'ASSIGN Assigned t [7]'
    assert told(caplog)[-1] == 'FETCH at 99999'
    assert len(caplog.records) < 100


def test_what_a_user_wants_to_debug_is_debugged() -> None:
    assert with_recording({'debug': 'broker'})['debug'] == 'broker'
    assert with_recording({})['debug'] == 'cgrp'


def test_what_it_makes_of_its_partitions_is_told_too(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    recorder = Recorder(logging.getLogger('client'))
    partitions = {
        '-1': {'desired': False, 'fetch_state': 'none'},
        '7': {'desired': True, 'broker': 2, 'fetch_state': 'active', 'next_offset': 5, 'else': 1},
    }
    report = {
        'cgrp': {'state': 'up', 'join_state': 'steady'},
        'brokers': {'k:9092/2': {'state': 'UP', 'rxidle': 12}},
        'topics': {'orders': {'partitions': partitions}},
    }
    recorder.on_statistics('not for us')
    recorder.on_statistics(json.dumps(report))
    recorder.tell(log('route'))
    assert [record.getMessage() for record in caplog.records] == [
        'the Kafka client reported: group: state up, join_state steady',
        'the Kafka client reported: k:9092/2: state UP, rxidle 12',
        'the Kafka client reported: orders[7]: broker 2, fetch_state active, next_offset 5',
    ]
    recorder.tell(log('route'))
    assert len(caplog.records) == 3


def test_a_report_that_cannot_be_read_is_left_out(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    recorder = Recorder(logging.getLogger('client'))
    recorder.on_statistics('{"client_id": "a "quote""}')
    recorder.tell(log('route'))
    assert not caplog.records
