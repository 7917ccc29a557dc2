"""Who has opened a connection, as the kernel knows it, and which addresses are one client."""

import os
import socket
import subprocess

import pytest

from ros2_kafka_bridge.web.caller import SocketAddress, network_of, user_of

NOBODY = 65534


def seen(accepted: socket.socket) -> int | None:
    """Who is at the other end of a connection that was accepted."""
    caller, own = accepted.getpeername(), accepted.getsockname()
    return user_of(SocketAddress(*caller[:2]), SocketAddress(*own[:2]))


@pytest.mark.parametrize('host', ['127.0.0.1', '::1'])
def test_the_user_of_a_connection_is_known_as_long_as_it_is_open(host: str) -> None:
    family = socket.AF_INET6 if ':' in host else socket.AF_INET
    with socket.create_server((host, 0), family=family) as listener:
        with socket.create_connection(listener.getsockname()[:2]):
            accepted, _ = listener.accept()
            assert seen(accepted) == os.getuid()
        assert seen(accepted) is None, 'what is closed is of nobody, not of root'
        accepted.close()


def test_a_caller_by_ipv4_is_known_where_both_are_listened_to() -> None:
    with (
        socket.create_server(('::', 0), family=socket.AF_INET6, dualstack_ipv6=True) as listener,
        socket.create_connection(('127.0.0.1', listener.getsockname()[1])),
    ):
        accepted, address = listener.accept()
        assert address[0] == '::ffff:127.0.0.1'
        assert seen(accepted) == os.getuid()
        accepted.close()


@pytest.mark.skipif(os.getuid() != 0, reason='only root can be somebody else')
def test_another_user_is_another() -> None:
    with socket.create_server(('127.0.0.1', 0)) as listener:
        ask = f'exec 3<>/dev/tcp/127.0.0.1/{listener.getsockname()[1]}; read'
        command = ['/bin/bash', '-c', ask]
        with subprocess.Popen(command, stdin=subprocess.PIPE, user=NOBODY) as other:
            accepted, _ = listener.accept()
            assert seen(accepted) == NOBODY
            accepted.close()
            other.communicate()


@pytest.mark.parametrize('host', ['10.1.2.3', '::ffff:10.1.2.3', 'fe80::1%eth0', ''])
def test_who_is_not_of_this_machine_is_nobody(host: str) -> None:
    assert user_of(SocketAddress(host, 4711), SocketAddress('10.1.2.4', 9464)) is None


@pytest.mark.parametrize(
    ('host', 'network'),
    [
        ('10.1.2.3', '10.1.2.3'),
        ('2001:db8:1:2:3:4:5:6', '2001:db8:1:2::/64'),
        ('2001:db8:1:2::1', '2001:db8:1:2::/64'),
        ('::ffff:10.1.2.3', '10.1.2.3'),
        ('fe80::1%eth0', 'fe80::/64'),
        ('testclient', 'testclient'),
    ],
)
def test_addresses_that_one_client_can_choose_among_are_one(host: str, network: str) -> None:
    assert network_of((host, 1)) == network
