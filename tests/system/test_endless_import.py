"""A message package whose import never ends holds up its own route: guarantee 6b."""

from collections.abc import Callable
from pathlib import Path

import pytest
from support.bridges.routes import values
from support.monitoring.scrapes import watched
from support.processes.harness import Bench
from support.ros.raw import publish, route, text

KEYS = 'diagnostic_msgs/msg/KeyValue'
IMPORTED = {'packages': 'import'}


@pytest.mark.parametrize('code', ['import time\nwhile True: time.sleep(1)', 'while True: pass'])
def test_guarantee_6b_an_import_without_end_holds_up_no_other_route_and_no_stop(
    bench: Bench, unique: Callable[[str], str], tmp_path: Path, code: str
) -> None:
    module = tmp_path / 'diagnostic_msgs' / 'msg' / '__init__.py'
    module.parent.mkdir(parents=True)
    (module.parent.parent / '__init__.py').touch()
    module.write_text(code)
    good = unique('good')
    routes = [
        route('/good', good, 'std_msgs/msg/String', 'good'),
        route('/keys', unique('keys'), KEYS, 'keys'),
    ]
    bridge = watched(bench, routes, pythonpath=str(tmp_path), ros=IMPORTED)
    messages = [text(b'%d' % number) for number in range(2000)]
    with bridge.process as process, publish(bench, '/good', messages):
        process.wait_for(f'keys: failed: message type {KEYS}: the import of its package has not')
        assert values(bench.records(good, 2000)) == messages
        bridge.becomes('livez', 200)
        bridge.becomes('readyz', 503, '[+]route/good ok: running')
        assert process.end() == 0
    assert 'good: stopped: 2000 taken, 2000 confirmed' in process.output()
    assert 'did not end in time' not in process.output()


def test_check_says_of_an_import_without_end_that_it_has_none(
    bench: Bench, unique: Callable[[str], str], tmp_path: Path
) -> None:
    module = tmp_path / 'diagnostic_msgs' / 'msg' / '__init__.py'
    module.parent.mkdir(parents=True)
    (module.parent.parent / '__init__.py').touch()
    module.write_text('import time\nwhile True: time.sleep(1)')
    config = str(bench.config([route('/keys', unique('keys'), KEYS, 'keys')], ros=IMPORTED))
    status, out, _ = bench.command('check', '--connect', config, PYTHONPATH=str(tmp_path))
    assert status == 1
    assert f'message type {KEYS}: the import of its package has not ended' in ' '.join(out.split())
