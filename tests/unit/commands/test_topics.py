"""What `topics` refuses before it asks anybody."""

from pathlib import Path

from command_line import typed


def test_a_wrong_file_and_two_answers_for_the_brokers_are_refused(tmp_path: Path) -> None:
    missing = tmp_path / 'missing.yaml'
    assert typed('topics', missing) == (2, '', f'{missing}: no such file\n')
    status, out, err = typed('topics', missing, '--bootstrap-servers', 'x')
    assert (status, out) == (2, '')
    assert err.startswith(f'--bootstrap-servers: {missing} says them already')
