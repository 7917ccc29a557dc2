"""What `check` says of a file without asking anybody."""

from pathlib import Path

from support.processes.terminal import typed

FILE = """\
name: b
kafka:
  bootstrap.servers: localhost:1
  MORE
routes:
  - {name: to_ros, from: {kafka: orders}, format: text, \
to: {ros: /orders, type: std_msgs/msg/String}}
  - {name: to_kafka, from: {ros: /orders}, to: {kafka: orders.returned}, format: text}
"""
SECRET = 'open-sesame'  # noqa: S105 (of the test)
SASL = [
    'security.protocol: SASL_PLAINTEXT',
    'sasl.mechanisms: PLAIN',
    'sasl.username: robot',
    f'sasl.password: {SECRET}',
]


def checked(place: Path, *kafka: str) -> tuple[int, str, str]:
    file = place / 'bridge.yaml'
    file.write_text(FILE.replace('MORE', '\n  '.join(kafka)))
    return typed('check', file)


def test_it_says_what_a_file_holds_and_masks_its_secrets(tmp_path: Path) -> None:
    status, out, err = checked(tmp_path, *SASL)
    assert (status, err) == (0, '')
    assert out.splitlines() == [
        f'{tmp_path}/bridge.yaml: 2 routes of bridge b, all well written',
        '  kafka bootstrap.servers: localhost:1',
        '  kafka security.protocol: SASL_PLAINTEXT',
        '  kafka sasl.mechanisms: PLAIN',
        '  kafka sasl.username: robot',
        '  kafka sasl.password: ***',
        '  to_ros: Kafka orders -> ROS /orders (std_msgs/msg/String), text',
        '  to_kafka: ROS /orders (the type that is published) -> Kafka orders.returned, text',
    ]


def test_it_names_what_a_weaker_setting_gives_up(tmp_path: Path) -> None:
    status, out, _ = checked(tmp_path, 'acks: 1')
    assert status == 0
    [note] = [line for line in out.splitlines() if line.startswith('  note ')]
    assert 'kafka.acks: 1' in note
    assert 'guarantee 2 falls' in note


def test_a_mistake_beside_a_secret_does_not_show_it(tmp_path: Path) -> None:
    wrong = [line.replace(': PLAIN', ': PLAINE') for line in SASL]
    more = [f'ssl.key.password: {SECRET}', 'ssl.ca.pem: x']
    status, out, err = checked(tmp_path, *wrong, *more)
    assert status == 2
    assert 'kafka.sasl.mechanisms: ' in err
    assert SECRET not in out + err
