"""The errors that speak to the user: the command line shows their text and no traceback."""

from typing import Final

from warehouse.domain.faults import FaultError
from warehouse.domain.maps import MapError
from warehouse.domain.profile_files import ProfileError
from warehouse.domain.site import SiteError
from warehouse.domain.trace_check import TraceError
from warehouse.kafka import AwayError
from warehouse.run_options import StartError
from warehouse.send import RequestError

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
