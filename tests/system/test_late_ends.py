"""The end of a transaction that reaches Kafka in the middle of the next one undoes none of it."""

import contextlib
import socket
from contextlib import suppress
from pathlib import Path
from threading import Thread
from typing import Final

from support.bridges.letters import written_one_by_one
from support.bridges.routes import values
from support.kafka.relay import Relay, node_behind
from support.processes.harness import Bench

from ros2_kafka_bridge.endpoints import Outgoing
from ros2_kafka_bridge.kafka.transactions import Parcel, Send
from ros2_kafka_bridge.testing.local_kafka import HOST, free_port

END: Final = 26
"""The number of the request that ends a transaction (EndTxn)."""


class LateEnd:
    """A way to Kafka that loses a connection with the end of a transaction, which comes later.

    The first end that comes this way is kept, its connection closed. It reaches Kafka just before
    the third, which is that of the next transaction: the second repeats it.
    """

    def __init__(self, behind: int) -> None:
        self._behind = behind
        self._kept = b''
        self.ends = 0

    def begin(self, client: socket.socket, server: socket.socket) -> None:
        Thread(target=self._ask, args=(client, server), daemon=True).start()
        Thread(target=self._answer, args=(server, client), daemon=True).start()

    def _ask(self, client: socket.socket, server: socket.socket) -> None:
        with suppress(OSError), client, server, client.makefile('rb') as asked:
            while size := asked.read(4):
                request = size + asked.read(int.from_bytes(size))
                if int.from_bytes(request[4:6]) == END:
                    self.ends += 1
                    if self.ends == 1:
                        self._kept = request
                        for one in (client, server):
                            one.shutdown(socket.SHUT_RDWR)
                        return
                    if self.ends == 3:
                        self._deliver()
                server.sendall(request)

    def _deliver(self) -> None:
        with socket.create_connection((HOST, self._behind)) as late:
            late.sendall(self._kept)
            assert late.recv(1)

    @staticmethod
    def _answer(server: socket.socket, client: socket.socket) -> None:
        with suppress(OSError):
            while data := server.recv(65_536):
                client.sendall(data)


def test_an_end_that_comes_late_leaves_the_next_transaction_whole(
    tmp_path: Path, topic_name: str, ros_domain: int
) -> None:
    behind = free_port()
    # Of the second transaction a part is refused, so that it is undone, and begun again.
    jobs = [[b'first'], [b'small', b'x' * 5000]]
    parcels = [
        [Parcel(number, [Send(Outgoing(topic_name, None, value, []), 0)]) for number, value in job]
        for job in map(enumerate, jobs)
    ]
    late = LateEnd(behind)
    with (
        Relay(behind, late.begin) as way,
        node_behind(tmp_path / 'kafka', behind, way.port) as node,
        contextlib.closing(Bench(tmp_path, node.bootstrap_servers, ros_domain)) as bench,
    ):
        bench.create_topic(topic_name, max_message_bytes='1000')
        written_one_by_one({'bootstrap.servers': way.address}, topic_name, parcels)
        assert values(bench.records(topic_name, 2)) == [b'first', b'small']
    assert late.ends >= 3
