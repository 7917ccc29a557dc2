"""What a terminal shows of what a command found."""

import io
import re

import pytest
from rich.console import Console
from support.processes.terminal import without_colours

from ros2_kafka_bridge.commands.screen import Finding, show_findings

FINDINGS = [
    Finding('ok', 'topic', 'topic orders has 3 partitions'),
    Finding(
        'bad',
        'readers',
        '/a/reader/with/rather/a/long/name_1234567 does not match: volatile is offered',
        'set to.qos: {durability: transient_local}',
    ),
]


@pytest.mark.parametrize('columns', [40, 80, 120])
def test_a_table_fits_its_terminal_and_cuts_nothing_off(columns: int) -> None:
    screen = io.StringIO()
    console = Console(file=screen, force_terminal=True, color_system='standard', width=columns)
    show_findings(console, 'orders', FINDINGS)
    shown = screen.getvalue()
    assert re.search(r'\x1b\[[0-9;]*32mok', shown), 'green'
    assert re.search(r'\x1b\[[0-9;]*31mBAD', shown), 'red'
    lines = without_colours(shown)
    assert max(map(len, lines)) <= columns
    all_of_it = ''.join(''.join(lines).split())
    for finding in FINDINGS:
        assert ''.join(f'{finding.text}{finding.cure and "->"}{finding.cure}'.split()) in all_of_it
