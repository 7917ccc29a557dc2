"""The end of a transaction that reaches Kafka in the middle of the next one undoes none of it."""

import contextlib
import socket
from contextlib import suppress
from pathlib import Path
from threading import Thread
from typing import Final, Self

from harness import Bench, values
from letters import written_one_by_one
from relay import node_behind

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
        self._server = socket.create_server((HOST, 0))
        self.port = int(self._server.getsockname()[1])
        self._kept = b''
        self.ends = 0

    def __enter__(self) -> Self:
        Thread(target=self._accept, daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        # What comes once Kafka is gone would fail in the midst of another test.
        self._server.shutdown(socket.SHUT_RDWR)
        self._server.close()

    def _accept(self) -> None:
        with suppress(OSError):  # it is closed
            while True:
                self._let_through(self._server.accept()[0])

    def _let_through(self, client: socket.socket) -> None:
        try:
            server = socket.create_connection((HOST, self._behind))
        except OSError:  # Kafka is gone
            client.close()
            return
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
    with (
        LateEnd(behind) as way,
        node_behind(tmp_path / 'kafka', behind, way.port) as node,
        contextlib.closing(Bench(tmp_path, node.bootstrap_servers, ros_domain)) as bench,
    ):
        bench.create_topic(topic_name, max_message_bytes='1000')
        written_one_by_one({'bootstrap.servers': f'{HOST}:{way.port}'}, topic_name, parcels)
        assert values(bench.records(topic_name, 2)) == [b'first', b'small']
    assert way.ends >= 3
