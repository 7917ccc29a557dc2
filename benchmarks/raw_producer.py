"""A producer of librdkafka without Python's client: it writes header names of any bytes.

confluent-kafka writes text as the name of a header, as every client of Kafka should. On the wire
it is bytes, and whoever may write to a topic may send any.
"""

import ctypes
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, Self

import confluent_kafka

Headers = Sequence[tuple[bytes, bytes | None]]

_PRODUCER: Final = 0
_TOPIC, _PARTITION, _VALUE, _KEY, _FLAGS, _HEADERS = 1, 3, 4, 5, 7, 10  # rd_kafka_vtype_t
_COPY_AND_WAIT: Final = 2 | 4  # RD_KAFKA_MSG_F_COPY, RD_KAFKA_MSG_F_BLOCK
_ERROR_CHARS: Final = 512


class RawProducer:
    """Produces to one partition, in order; a `with` ends when all has been confirmed."""

    def __init__(self, bootstrap_servers: str, flush_s: float = 300.0) -> None:
        self._flush_s = flush_s
        self._lib = _library()
        error = ctypes.create_string_buffer(_ERROR_CHARS)
        conf = self._lib.rd_kafka_conf_new()
        properties = {
            'bootstrap.servers': bootstrap_servers,
            'enable.idempotence': 'true',
            'linger.ms': '20',
            'message.max.bytes': '20000000',
            'queue.buffering.max.kbytes': '65536',
            'log_level': '3',
        }
        for name, value in properties.items():
            if self._lib.rd_kafka_conf_set(
                conf, name.encode(), value.encode(), error, _ERROR_CHARS
            ):
                raise ValueError(error.value.decode())
        self._client = self._lib.rd_kafka_new(_PRODUCER, conf, error, _ERROR_CHARS)
        if not self._client:
            raise ValueError(error.value.decode())

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        left = self._lib.rd_kafka_flush(self._client, int(self._flush_s * 1000))
        self._lib.rd_kafka_destroy(self._client)
        if left:
            raise TimeoutError(f'Kafka did not take all within {self._flush_s:.0f} s')

    def produce(
        self, topic: str, value: bytes | None, key: bytes | None = None, headers: Headers = ()
    ) -> None:
        """Hand over a record; waits while the queue is full."""
        made = ctypes.c_void_p(self._lib.rd_kafka_headers_new(len(headers)))
        for name, content in headers:
            size = -1 if content is None else len(content)
            self._lib.rd_kafka_header_add(made, name, len(name), content, size)
        status = self._lib.rd_kafka_producev(
            ctypes.c_void_p(self._client),
            *(ctypes.c_int(_TOPIC), ctypes.c_char_p(topic.encode())),
            *(ctypes.c_int(_PARTITION), ctypes.c_int32(0)),
            *(ctypes.c_int(_VALUE), *_bytes(value)),
            *(ctypes.c_int(_KEY), *_bytes(key)),
            *(ctypes.c_int(_FLAGS), ctypes.c_int(_COPY_AND_WAIT)),
            *(ctypes.c_int(_HEADERS), made),
            ctypes.c_int(0),
        )
        if status:
            self._lib.rd_kafka_headers_destroy(made)
            raise ValueError(f'librdkafka refuses a record: error {status}')


def _bytes(value: bytes | None) -> tuple[ctypes.c_char_p, ctypes.c_size_t]:
    return ctypes.c_char_p(value), ctypes.c_size_t(len(value or b''))


def _library() -> Any:
    """The librdkafka that Python's client has loaded already."""
    place = Path(confluent_kafka.__file__).parents[1] / 'confluent_kafka.libs'
    found = sorted(place.glob('librdkafka-*.so*'))
    if not found:
        raise OSError(f'no librdkafka in {place}: it comes with the wheels of confluent-kafka')
    lib = ctypes.CDLL(str(found[0]))
    pointer, text, size = ctypes.c_void_p, ctypes.c_char_p, ctypes.c_ssize_t
    lib.rd_kafka_conf_new.restype = pointer
    lib.rd_kafka_conf_set.argtypes = [pointer, text, text, text, ctypes.c_size_t]
    lib.rd_kafka_new.restype = pointer
    lib.rd_kafka_new.argtypes = [ctypes.c_int, pointer, text, ctypes.c_size_t]
    lib.rd_kafka_headers_new.restype = pointer
    lib.rd_kafka_headers_new.argtypes = [ctypes.c_size_t]
    lib.rd_kafka_headers_destroy.argtypes = [pointer]
    lib.rd_kafka_header_add.argtypes = [pointer, text, size, text, size]
    lib.rd_kafka_flush.argtypes = [pointer, ctypes.c_int]
    lib.rd_kafka_destroy.argtypes = [pointer]
    return lib
