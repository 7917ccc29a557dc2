"""The demonstration as a new user runs it: with Python alone."""

from pathlib import Path

from support.bridges.demos import all_equal, counted, demo


def test_every_order_comes_back_over_the_embedded_broker(tmp_path: Path, ros_domain: int) -> None:
    assert ros_domain, 'of its own'
    with demo(tmp_path, '--rate', '300', '--seconds', '3') as process:
        assert process.wait(60) == 0, process.output()
    result = counted(process)
    assert result['produced'] == '900'
    assert all_equal(result)
    shown = process.output()
    assert 'this bridge: sending' in shown
    assert '\x1b' not in shown
    assert '\r' not in shown
    assert [*tmp_path.iterdir()] == [process.log], 'nothing is left'
