"""How a route fares in a running bridge: at one stage at a time, with what is known at that one.

Values, and no clock: the runner says what has happened, and when.
"""

from dataclasses import dataclass
from typing import Final, NamedTuple, Self

from ros2_kafka_bridge.errors import About, BridgeError, ConfigError, RouteError, SpoolInUseError
from ros2_kafka_bridge.route.counters import State
from ros2_kafka_bridge.threads.backoff import Backoff

# A run that was longer than this was well, also where there was nothing to send. Not less: an
# unknown topic is noticed after half a minute of nothing.
_WELL_S: Final = 180.0


class Failure(NamedTuple):
    """Why a route has failed: the words alone, for an error holds all that it passed on its way.

    Args:
        text: As a person is told it.
        about: The record or message that it is for, if it is for one.
        holder: Which process still has the spool, in words; None where that was not it.
    """

    text: str
    about: About | None = None
    holder: str | None = None

    @classmethod
    def of(cls, error: BridgeError) -> Self:
        """Keep what is told of an error."""
        about = error.about if isinstance(error, RouteError) else None
        holder = error.short if isinstance(error, SpoolInUseError) else None
        return cls(str(error), about, holder)


@dataclass(frozen=True, slots=True)
class Running:
    """Nothing is in its way: it is made, starts or runs, and tells itself what it does."""


@dataclass(frozen=True, slots=True)
class Failed:
    """It is tried again."""

    failure: Failure


@dataclass(frozen=True, slots=True)
class FailedForGood:
    """Trying again cannot help."""

    failure: Failure


@dataclass(frozen=True, slots=True)
class Ended:
    """It has failed at a stop, after which nothing is tried again."""

    failure: Failure


RouteStage = Running | Failed | FailedForGood | Ended


class Shown(NamedTuple):
    """What a snapshot says of a route that does not tell it itself."""

    state: State
    reason: str
    final: bool = False


class FailureHistory(NamedTuple):
    """What the failures of a route say of the next one.

    Args:
        times: How many there were.
        last: The last; None where it never has failed.
        carried: How many messages were carried by then.
        since_s: Since when it has failed, and has not been well in between.
        backoff: How long to wait after the last.
    """

    times: int = 0
    last: Failure | None = None
    carried: int = 0
    since_s: float | None = None
    backoff: Backoff = Backoff()

    def after(self, failure: Failure, now_s: float, ran_s: float, carried: int) -> Self:
        """What they say after one more."""
        was_well = carried > self.carried or ran_s > _WELL_S
        since_s = now_s if self.since_s is None or was_well else self.since_s
        backoff = self.backoff.after(ran_s)
        return self.__class__(self.times + 1, failure, carried, since_s, backoff)

    def says(self, carried: int) -> str:
        """What is said of the last while the route waits, and has carried nothing since."""
        if self.last is None or carried != self.carried:
            return ''
        return f'; has failed before: {self.last.text}'


class RouteStatus(NamedTuple):
    """How a route fares; each method tells how it fares after something has happened.

    Args:
        stage: What it is at.
        history: What its failures so far say.
        began_s: When the last try began.
        has_begun: Whether what runs the route runs in it, and is not made or waited for any more.
        drains: Whether a stop was asked for by then: there is none after this one.
        retries: Whether what runs it has failed since that was made.
        instead: What somebody else says of it, until it runs or fails.
    """

    stage: RouteStage = Running()
    history: FailureHistory = FailureHistory()
    began_s: float = 0.0
    has_begun: bool = False
    drains: bool = False
    retries: bool = False
    instead: Shown | None = None

    @property
    def failure(self) -> Failure | None:
        """Why it does not run, as far as that is a failure."""
        return None if isinstance(self.stage, Running) else self.stage.failure

    @property
    def shown(self) -> Shown | None:
        """What is said of it; None where that is for what runs the route to say."""
        if self.instead is not None or self.failure is None:
            return self.instead
        return Shown(State.FAILED, self.failure.text, final=isinstance(self.stage, FailedForGood))

    def tried(self, now_s: float, *, drains: bool) -> Self:
        """A try begins; what was in the way may be still."""
        return self._replace(began_s=now_s, has_begun=False, drains=drains)

    def running(self) -> Self:
        """Nothing is in the way any more."""
        return self._replace(stage=Running(), has_begun=True, instead=None)

    def noted(self, error: BridgeError, now_s: float, carried: int) -> Self:
        """Something has failed, and that may have nothing to do with what runs the route."""
        ran_s = now_s - self.began_s
        return self._replace(history=self.history.after(Failure.of(error), now_s, ran_s, carried))

    def failed(
        self, error: BridgeError, now_s: float, carried: int, *, stops: bool, ours: bool
    ) -> Self:
        """What runs the route has failed.

        Args:
            error: What is in the way.
            now_s: The time.
            carried: How many messages are by now.
            stops: Whether a stop is asked for.
            ours: Whether no other bridge goes on with it: else nothing is for good.
        """
        failure, final = Failure.of(error), _is_final(error)
        if self.drains or (final and stops):
            stage: RouteStage = Ended(failure)
        elif final and ours:
            stage = FailedForGood(failure)
        else:
            stage = Failed(failure)
        return self.noted(error, now_s, carried)._replace(stage=stage, retries=True, instead=None)

    def anew(self) -> Self:
        """It is run anew: what has failed before was in other circumstances."""
        history = self.history._replace(since_s=None)
        return self._replace(stage=Running(), history=history, retries=False)


def _is_final(error: BridgeError) -> bool:
    """Whether trying again cannot help."""
    return isinstance(error, ConfigError) or (isinstance(error, RouteError) and error.final)
