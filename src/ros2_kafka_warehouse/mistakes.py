"""The errors that speak to the user: the command line shows their text and no traceback."""

from typing import Final

from ros2_kafka_warehouse.domain.faults import FaultError
from ros2_kafka_warehouse.domain.maps import MapError
from ros2_kafka_warehouse.domain.profile_files import ProfileError
from ros2_kafka_warehouse.domain.site import SiteError
from ros2_kafka_warehouse.domain.trace_check import TraceError
from ros2_kafka_warehouse.kafka import AwayError
from ros2_kafka_warehouse.run_options import StartError
from ros2_kafka_warehouse.send import RequestError

MISTAKES: Final = (
    AwayError,
    FaultError,
    MapError,
    ProfileError,
    RequestError,
    SiteError,
    StartError,
    TraceError,
)
