"""`dead-letters`: letters that a real bridge has made are found, shown, and sent again once."""

import json
import re
import shlex
from pathlib import Path

from support.bridges.letters import HOSTILE, SMALL, done, long, route
from support.bridges.routes import to_kafka
from support.bridges.words import wait_for_commit
from support.processes.harness import Bench
from support.ros.robots import installed, random_cdr, robot

from ros2_kafka_bridge.dead_letters.writer import explain, from_ros
from ros2_kafka_bridge.endpoints import Outgoing
from ros2_kafka_bridge.errors import EncodeError
from ros2_kafka_bridge.formats.json import make_encode
from ros2_kafka_bridge.formats.scope import Scope
from ros2_kafka_bridge.message_types import load_layout

CRATE = 'acme_crates/msg/Crate'
ROOT = Path(__file__).parents[2]


def run_docs(bench: Bench, config: Path, topic: str) -> list[str]:
    """What the commands of the docs print, run in their order on this topic."""
    text = (ROOT / 'docs' / 'dead-letters.md').read_text()
    blocks = re.findall(r'```sh\n(.*?)```', text, re.DOTALL)
    outputs = []
    for line in ''.join(blocks).splitlines():
        program, command, *arguments = shlex.split(line)
        assert (program, command) == ('ros2-kafka-bridge', 'dead-letters')
        here = {'bridge.yaml': str(config), 'orders': 'to_ros'}
        named = [a.replace('orders.', f'{topic}.') for a in arguments]
        outputs.append(done(bench, *[here.get(a, a) for a in named]))
    return outputs


def test_letters_are_listed_shown_and_replayed_once_with_the_commands_of_the_docs(
    bench: Bench, topic_name: str
) -> None:
    letters = f'{topic_name}.dead-letters'
    was = [('trace', HOSTILE), ('trace', b'again'), ('none', None), ('bridge.origin', b'other')]
    bench.create_topic(topic_name, partitions=2)
    bench.produce(topic_name, [b'good', long(1)], key=b'key', headers=was, partition=1)
    with bench.drained(bench.config([route(topic_name, SMALL)])) as bridge:
        wait_for_commit(bench, topic_name, 2, bridge, partition=1)
    config = bench.config([route(topic_name)])

    listed, chosen, shown, planned, replayed = run_docs(bench, config, topic_name)
    assert f'{letters}[0]@0' in listed
    assert f'{topic_name}[1]@1' in listed
    assert 'RecordTooLargeError: 102 bytes, more than max_message_bytes' in listed
    assert re.search(r'to_ros +RecordTooLargeError: # bytes, .* 1 +0\n', listed)
    assert chosen == listed
    assert r'trace = \x1b[2J\r\xff\u202e' in shown
    assert '\x1b' not in listed + shown
    assert shown.count('x' * SMALL) == 1
    assert f'would replay: {letters}[0]@0 to {topic_name}\n' in planned
    assert f'1 letter replayed to {topic_name}\n' in replayed

    assert '0 letters replayed; 1 replayed before' in done(bench, 'replay', config, '--all')
    [record] = [r for r in bench.records(topic_name, 3) if r.offset() == 2]  # after the dry run
    assert (record.partition(), record.key(), record.value()) == (1, b'key', long(1))
    assert record.headers() == was
    [told] = json.loads(done(bench, 'list', config, '--json'))['letters']
    assert told['replayed']['to'] == topic_name
    assert (told['about']['partition'], told['about']['offset'], told['bytes']) == (1, 1, 102)
    assert done(bench, 'show', config, '--offset', '0', '--raw').encode() == long(1)
    with bench.bridge(config) as bridge:  # the mark of the transaction takes an offset, too
        wait_for_commit(bench, topic_name, 4, bridge, partition=1)
        assert bridge.end() == 0
        assert 'dead_letter' not in bridge.output()


def test_a_message_of_a_type_that_a_node_alone_describes_is_replayed(
    bench: Bench, topic: str, tmp_path: Path
) -> None:
    letters = f'{topic}.dead-letters'
    prefix = installed(tmp_path, 'acme_crates', {'Crate': 'string label\nfloat64[2] at\n'})
    layout = load_layout(CRATE, [prefix / 'src'])
    [message] = random_cdr(CRATE, prefix / 'src', 1)
    letter = explain(
        Outgoing(
            letters,
            None,
            message,
            [('ros.type', CRATE), ('ros.type_hash', layout.type_hash or '')],
        ),
        EncodeError('it was too large then'),
        from_ros('to_kafka', '/crates', topic),
    )
    bench.create_topic(letters)
    bench.produce(letters, [message], headers=letter.headers)
    crates = to_kafka('/crates', topic, format='json') | {'from': {'ros': '/crates'}}
    config = bench.config([crates])
    with robot(bench, CRATE, prefix, takes={'/crates': bench.place / 'took'}):
        assert f'1 letter replayed to {topic}\n' in done(bench, 'replay', config, '--all')
    [record] = bench.records(topic, 1)
    assert record.value() == make_encode(layout, Scope(''))(message)
