"""Looks at the records of a Kafka topic as they come, or sends one.

python examples/records.py odom --count 3
python examples/records.py orders --send 'two apples'
"""

import argparse
import sys
import uuid

from confluent_kafka import Consumer, KafkaException, Message, Producer


def text(value: bytes | str | None) -> str:
    """What people read of it."""
    return value.decode(errors='backslashreplace') if isinstance(value, bytes) else value or ''


def show(record: Message) -> None:
    """Print its key, its headers (a name may stand there twice), and what is in it."""
    headers = record.headers() or []
    print(f'offset {record.offset()}, key {text(record.key())}')
    for name, value in headers.items() if isinstance(headers, dict) else headers:
        print(f'  {name}: {text(value)}')
    print(f'  {text(record.value())}', flush=True)


def main() -> None:
    """Read or send, as is asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('topic')
    parser.add_argument('--send', metavar='VALUE', help='instead of reading')
    parser.add_argument('--count', type=int, default=sys.maxsize, help='records to read')
    parser.add_argument('--from-beginning', action='store_true', help='read the old ones, too')
    parser.add_argument('--bootstrap-servers', default='localhost:9092')
    args = parser.parse_args()
    servers = {'bootstrap.servers': args.bootstrap_servers, 'log_level': 2}

    if args.send is not None:
        producer = Producer(servers)
        producer.list_topics(timeout=5.0)  # raises where no Kafka answers
        producer.produce(args.topic, args.send.encode())
        producer.flush()
        print(f'sent to {args.topic}')
        return
    begin = 'earliest' if args.from_beginning else 'latest'
    consumer = Consumer(
        {**servers, 'group.id': f'look-{uuid.uuid4()}', 'auto.offset.reset': begin}
    )
    if args.topic not in consumer.list_topics(timeout=5.0).topics:
        sys.exit(f'Kafka has no topic {args.topic}: make it first')
    consumer.subscribe([args.topic])
    if not args.from_beginning:
        print(f'waits for the next record of {args.topic}; Ctrl-C ends it', flush=True)
    shown = 0
    while shown < args.count:
        record = consumer.poll(0.1)
        if record is not None and record.error() is None:
            show(record)
            shown += 1
    consumer.close()


if __name__ == '__main__':
    try:
        main()
    except KeyboardInterrupt:
        pass
    except KafkaException as error:
        sys.exit(f'Kafka: {error.args[0].str()}; does it run, and there?')
