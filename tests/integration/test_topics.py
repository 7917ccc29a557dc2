"""`topics`: both sides as they are, the routes between them, and who would match."""

import json
import re
from collections.abc import Callable
from pathlib import Path

from support.bridges.routes import to_kafka, to_ros
from support.processes.harness import Bench
from support.ros.robots import installed, robot
from support.said import OFFERED, row


def test_both_sides_are_shown_with_their_routes(
    bench: Bench, unique: Callable[[str], str]
) -> None:
    orders, missing = unique('orders'), unique('missing')
    bench.create_topic(orders, partitions=2)
    bench.create_topic(f'{orders}.dead-letters')
    bench.produce(orders, [b'a', b'b', b'c'])
    routes = [
        to_ros(orders, '/orders', name='in'),
        to_kafka('/status', missing, name='out'),
        to_kafka('/nobody', missing, name='later'),
    ]
    file = bench.config(routes)
    with (
        bench.subscriber('/orders', bench.place / 'a', '--durability', 'transient_local') as late,
        bench.subscriber('/orders', bench.place / 'b') as early,
        bench.publisher('/status', '--count', '0', '--readers', '0') as publisher,
    ):
        late.wait_for('ready')
        early.wait_for('ready')
        publisher.wait_for('published')
        status, out, err = bench.command('topics', str(file))
    assert (status, err) == (0, '')
    assert row(out, orders) == f'{orders} 2 3 in reads'
    hidden = 'not there, or this user may not see it'
    assert row(out, missing) == f'{missing} - - out writes; later writes; {hidden}'
    assert row(out, f'{orders}.dead-letters') == f'{orders}.dead-letters 1 0 dead letters'
    ends = '- 1 reliable, transient_local; 1 reliable, volatile'
    assert row(out, '/orders') == f'/orders std_msgs/msg/String {ends} in publishes'
    assert row(out, '/status') == '/status std_msgs/msg/String 1 reliable, volatile - out takes'
    assert row(out, '/nobody') == '/nobody nobody is there - - later takes'
    assert row(out, '/rosout').endswith(' of ROS itself')
    text = ' '.join(out.split())
    assert re.search(
        rf'in /subscriber_\d+ does not match: {OFFERED}; set to\.qos: \{{durability', text
    )
    assert re.search(r'in /subscriber_\d+ yes', text)
    assert re.search(r'out /publisher_\d+ yes', text)
    assert 'later - nobody publishes /nobody' in text


def test_a_type_that_a_node_alone_describes_is_shown_with_it_and_counted(
    bench: Bench, topic_name: str, tmp_path: Path
) -> None:
    prefix = installed(tmp_path, 'acme_tf', {'Moved': 'string text\n', 'Lied': 'int32 x\n'})
    moved = to_ros(topic_name, '/moved', format='json')
    latched = {'durability': 'transient_local'}
    moved['to'] = {'ros': '/moved', 'type': 'acme_tf/msg/Moved', 'qos': latched}
    took = {'/moved': bench.place / 'took'}
    with (
        robot(
            bench, 'acme_tf/msg/Moved', prefix, '--name', 'mover',
            publishes={'/moved': []}, takes=took,
        ),
        robot(
            bench, 'acme_tf/msg/Lied', prefix, '--name', 'liar', '--describes', 'lies',
            publishes={'/lied': []},
        ),
    ):  # fmt: skip
        file = str(bench.config([moved]))
        status, out, err = bench.command('topics', file, '--rates', '0.5', '--json')
    assert (status, err) == (0, '')
    shown = {row['name']: row for row in json.loads(out)['ros']}
    found, lied = shown['/moved'], shown['/lied']
    assert found['type_origins'] == {'acme_tf/msg/Moved': 'is described by the node /mover'}
    assert found['rate'] == 0, 'it was counted'
    [match] = found['matches']
    assert (match['problem'], match['unknown']) == ('', ''), 'the same definition, as is known'
    assert '/liar describes another' in lied['type_problems']['acme_tf/msg/Lied']
    assert lied['rate'] is None
