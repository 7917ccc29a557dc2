"""Which definition of its type a dead letter was written with."""

from ros2_kafka_bridge.dead_letters.letter import Letter
from ros2_kafka_bridge.message_types.source import NOT_SHOWN, Definitions


def definition_of(letter: Letter) -> Definitions:
    """How the type of a message of ROS was defined where it came from, as far as it tells."""
    text = letter.told('ros.type_hash')
    return {text: 'the letter'} if text else NOT_SHOWN
