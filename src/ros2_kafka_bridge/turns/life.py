"""How a route fares in a running bridge: at one stage at a time, with what is known at that one.

Values, and no clock: the runner says what has happened, and when.
"""

from dataclasses import dataclass, replace
from typing import Final, NamedTuple, Self

from ros2_kafka_bridge.errors import About, BridgeError, ConfigError, RouteError, SpoolInUseError
from ros2_kafka_bridge.route.counters import State
from ros2_kafka_bridge.threads.backoff import Backoff

# A run that was longer than this was well, also where there was nothing to send. Not less: an
# unknown topic is noticed after half a minute of nothing.
_WELL_S: Final = 180.0
_JOINS: Final = 'asks Kafka which bridge runs this route'

STANDS_BY: Final = 'stands by: another bridge runs this route'
"""What a route says of itself meanwhile."""


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


class Owed(NamedTuple):
    """What a bridge has on disk while another runs the route: it delivers that as well.

    Args:
        look_at_s: When to look for it; infinite once it is delivered.
        failure: Why it is still there; None where nothing has failed.
    """

    look_at_s: float = 0.0
    failure: Failure | None = None


class SpoolWait(NamedTuple):
    """How the spool of a term is waited for, while another process has it.

    Args:
        since_s: Since when; None where it is not, or its time was up.
        in_vain: How often its time was up while a bridge stood by.
    """

    since_s: float | None = None
    in_vain: int = 0


@dataclass(frozen=True, slots=True)
class Running:
    """Nothing is in its way: it is made, starts or runs, and tells itself what it does."""


@dataclass(frozen=True, slots=True)
class AwaitingTurn:
    """Kafka does not tell which bridge runs it: `away` says why; empty while it is asked."""

    away: str
    owed: Owed


@dataclass(frozen=True, slots=True)
class StandingBy:
    """Another bridge runs it; `failure` is what failed since the lock was heard last."""

    owed: Owed
    failure: Failure | None = None


@dataclass(frozen=True, slots=True)
class AwaitingSpool:
    """Its turn has come, but another process has its spool: `holder` says which."""

    holder: str
    wait: SpoolWait


@dataclass(frozen=True, slots=True)
class Failed:
    """It is tried again; what it owed and waited for goes on."""

    failure: Failure
    owed: Owed
    wait: SpoolWait


@dataclass(frozen=True, slots=True)
class FailedForGood:
    """Trying again cannot help."""

    failure: Failure


@dataclass(frozen=True, slots=True)
class Ended:
    """It has failed at a stop, after which nothing is tried again."""

    failure: Failure


LifeStage = Running | AwaitingTurn | StandingBy | AwaitingSpool | Failed | FailedForGood | Ended


class Shown(NamedTuple):
    """What a snapshot says of a stage."""

    state: State
    reason: str
    final: bool = False


class Past(NamedTuple):
    """What the failures of a route say of the next one.

    Args:
        failure: The last; None where it never has failed.
        carried: How many messages were carried by then.
        since_s: Since when it has failed in this term, and has not been well in between.
        backoff: How long to wait after the last.
    """

    failure: Failure | None = None
    carried: int = 0
    since_s: float | None = None
    backoff: Backoff = Backoff()

    def after(self, failure: Failure, now_s: float, ran_s: float, carried: int) -> Self:
        """What they say after one more."""
        was_well = carried > self.carried or ran_s > _WELL_S
        since_s = now_s if self.since_s is None or was_well else self.since_s
        return self.__class__(failure, carried, since_s, self.backoff.after(ran_s))

    def says(self, carried: int) -> str:
        """What is said of the last while the route waits, and has carried nothing since."""
        if self.failure is None or carried != self.carried:
            return ''
        return f'; has failed before: {self.failure.text}'


class Life(NamedTuple):
    """How a route fares; each method tells how it fares after something has happened.

    Args:
        stage: What it is at.
        past: What its failures so far say.
        began_s: When the last try began.
        drains: Whether a stop was asked for by then: there is none after this one.
        retries: Whether what runs it has failed in this term.
    """

    stage: LifeStage = Running()
    past: Past = Past()
    began_s: float = 0.0
    drains: bool = False
    retries: bool = False

    # What is asked

    @property
    def failure(self) -> Failure | None:
        """Why it does not run, as far as that is a failure."""
        match self.stage:
            case StandingBy(failure=failure):
                return failure
            case Failed() | FailedForGood() | Ended():
                return self.stage.failure
            case _:
                return None

    @property
    def owed(self) -> Owed:
        """What this bridge has on disk while another runs the route."""
        match self.stage:
            case AwaitingTurn(owed=owed) | StandingBy(owed=owed) | Failed(owed=owed):
                return owed
            case _:
                return Owed()

    @property
    def wait(self) -> SpoolWait:
        """How its spool is waited for."""
        match self.stage:
            case AwaitingSpool(wait=wait) | Failed(wait=wait):
                return wait
            case _:
                return SpoolWait()

    @property
    def shown(self) -> Shown | None:
        """What is said of it; None where that is for what runs the route to say."""
        match self.stage:
            case AwaitingTurn(away=away):
                return Shown(State.WAITING, away or _JOINS)
            case StandingBy(failure=None, owed=owed):
                return Shown(State.WAITING, _stands_by(owed))
            case AwaitingSpool(holder=holder):
                return Shown(State.WAITING, waits_for_spool(holder))
            case FailedForGood(failure=failure):
                return Shown(State.FAILED, failure.text, final=True)
            case StandingBy(failure=Failure(text)) | Failed(Failure(text)) | Ended(Failure(text)):
                return Shown(State.FAILED, text)
            case _:
                return None

    # What happens, whoever runs the route

    def tried(self, now_s: float, *, drains: bool) -> Self:
        """A try begins; what was in the way may be still."""
        return self._replace(began_s=now_s, drains=drains)

    def running(self) -> Self:
        """Nothing is in the way any more."""
        return self._replace(stage=Running())

    def failed(
        self, error: BridgeError, now_s: float, carried: int, *, stops: bool, over: bool
    ) -> Self:
        """It has failed.

        Args:
            error: What is in the way.
            now_s: The time.
            carried: How many messages are by now.
            stops: Whether a stop is asked for.
            over: Whether another bridge has its lock: then nothing is for good.
        """
        failure, final = Failure.of(error), _is_final(error)
        if self.drains or (final and stops):
            stage: LifeStage = Ended(failure)
        elif final and not over:
            stage = FailedForGood(failure)
        else:
            stage = Failed(failure, self.owed, self._wait_after(failure))
        return self._after(failure, now_s, carried)._replace(stage=stage, retries=True)

    def _wait_after(self, failure: Failure) -> SpoolWait:
        return self.wait if failure.holder is None else self.wait._replace(since_s=None)

    def _after(self, failure: Failure, now_s: float, carried: int) -> Self:
        past = self.past.after(failure, now_s, now_s - self.began_s, carried)
        return self._replace(past=past)

    # What happens while another bridge runs it

    def failed_meanwhile(self, error: BridgeError, now_s: float, carried: int) -> Self:
        """This bridge could not wait for its turn: that is tried again, whatever it is.

        One that stood by still does: Kafka has told nothing else.
        """
        failure = Failure.of(error)
        stage: LifeStage = Failed(failure, self.owed, SpoolWait())
        if isinstance(self.stage, StandingBy):
            stage = StandingBy(self.owed, failure)
        return self._after(failure, now_s, carried)._replace(stage=stage)

    def heard(self, *, joined: bool, away: str) -> Self:
        """The lock is not held.

        Args:
            joined: Whether Kafka had told who holds it.
            away: Why it does not tell now.
        """
        failure = self.failure
        if joined and not away:
            stage: LifeStage = StandingBy(self.owed)
        elif joined or failure is None:
            stage = AwaitingTurn(away, self.owed)
        else:  # until Kafka has told, that is what is known
            stage = Failed(failure, self.owed, SpoolWait())
        return self._replace(stage=stage)

    def owing(self, owed: Owed) -> Self:
        """It stands by, and has looked for what it has on disk."""
        return self._replace(stage=StandingBy(owed, self.failure))

    def undelivered(self, error: BridgeError, now_s: float, carried: int) -> Self:
        """It stands by, and could not deliver what it has on disk: that is tried again."""
        failure = Failure.of(error)
        after = self._after(failure, now_s, carried)
        owed = Owed(now_s + after.past.backoff.wait_s, failure)
        return after._replace(stage=StandingBy(owed, failure))

    # What happens in its turn

    def in_turn(self) -> Self:
        """It has come: what kept this bridge from it counts no more."""
        failure = self.failure
        stage = Running() if failure is None else Failed(failure, Owed(), SpoolWait())
        past = self.past._replace(since_s=None)
        return self._replace(stage=stage, past=past, retries=False)

    def without_spool(self, in_use: SpoolInUseError, now_s: float) -> Self:
        """Another process has its spool still."""
        wait = self.wait
        if wait.since_s is None:
            wait = wait._replace(since_s=now_s)
        return self._replace(stage=AwaitingSpool(in_use.short, wait))

    def sought(self, *, wanted: bool) -> Self:
        """It was asked whether a bridge stands by to leave it to; one not told of is none."""
        if not isinstance(self.stage, Failed):
            return self
        failure, wait = self.stage.failure, self.stage.wait
        in_vain = wait.in_vain + int(failure.holder is not None) if wanted else 0
        stage = replace(self.stage, wait=wait._replace(in_vain=in_vain))
        return self._replace(stage=stage)


def waits_for_spool(holder: str) -> str:
    """What is said of a route whose spool another process has.

    Args:
        holder: Which one, in words.
    """
    return f'its turn has come, but {holder}'


def _is_final(error: BridgeError) -> bool:
    return isinstance(error, ConfigError) or (isinstance(error, RouteError) and error.final)


def _stands_by(owed: Owed) -> str:
    if owed.failure is None:
        return STANDS_BY
    return f'{STANDS_BY}; what this one has on disk is not delivered: {owed.failure.text}'
