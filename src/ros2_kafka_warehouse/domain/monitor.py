"""Monitor: watches every robot, finds out what failed, and has something done about it.

Three things, apart from each other: detection (`evidence`: what is to be seen), diagnosis
(`robot_failure_profile`: what it means) and response (`execution_profiles`: what is done, by
`failures`). What the other modules act on is the report: who may move, who keeps its tasks, what
is an obstacle. Each step is an event with its cause, its evidence and its outcome.
"""

from itertools import chain
from typing import Final, NamedTuple

import msgspec

from ros2_kafka_warehouse.domain.casebook import FLEET, VIOLATION, Casebook
from ros2_kafka_warehouse.domain.evidence import Watch
from ros2_kafka_warehouse.domain.execution_profiles import ExecutionProfiles
from ros2_kafka_warehouse.domain.grid import Grid
from ros2_kafka_warehouse.domain.monitor_memory import SignsKept, fingerprint, memory_of
from ros2_kafka_warehouse.domain.pauses import Pauses
from ros2_kafka_warehouse.domain.response import Responder
from ros2_kafka_warehouse.domain.robot_failure_profile import RobotFailureProfile
from ros2_kafka_warehouse.domain.signs import CONTACT, NO_PROGRESS, Signs
from ros2_kafka_warehouse.domain.site import Site
from ros2_kafka_warehouse.domain.standing import WELL, Standing, report_of, standings_of
from ros2_kafka_warehouse.domain.task_watch import TaskWatch
from ros2_kafka_warehouse.messages.message import node_cell, node_id
from ros2_kafka_warehouse.messages.monitor import (
    FailureEvent,
    FleetReport,
    OperatorCommand,
    RobotReport,
)
from ros2_kafka_warehouse.messages.onlookers import ValidatorReport, Violation
from ros2_kafka_warehouse.messages.robots import FleetOrders, FleetState, InstantActions
from ros2_kafka_warehouse.messages.tasks import Tasks

LOOK_STEPS: Final = 8  # how often what changes slowly is looked at
COMMANDS_KEPT: Final = 200


class Judgement(NamedTuple):
    """What the Monitor says after a step."""

    report: FleetReport
    actions: InstantActions
    events: tuple[FailureEvent, ...]


class Monitor:
    """Watches the fleet of a site.

    Call `observe` for each state, in order; `expect`, `know`, `operate` and `check` as messages
    come; then `judge`. Without new states `judge` is to be called now and then, for time passes.
    """

    def __init__(self, site: Site) -> None:
        grid = Grid(site.rows)
        self._site = fingerprint(site)
        self._chargers = frozenset(site.chargers)
        self._watches: dict[str, Watch] = {}
        self._fleet_signs = Signs()
        self._book = Casebook(grid, self._watches)
        self._responder = Responder(self._book, grid, self._chargers, self._watches)
        self._pauses = Pauses(self._book, self._watches)
        self._book.is_dirty = True  # that of which site it is has to be said from the start
        self._task_watch = TaskWatch(grid, self._chargers)
        self._floor: dict[str, str] = {}
        self._fleet_seen_s: float | None = None
        self._violations: tuple[Violation, ...] = ()
        self._memory_text = ''
        self._standings: dict[str, Standing] = {}

    # What comes in

    def observe(self, fleet: FleetState, now_s: float) -> None:
        """The next state of the fleet."""
        step = fleet.step
        self._book.step = step
        self._floor = fleet.floor
        self._fleet_seen_s = now_s
        watches = self._watches
        chargers = self._chargers
        removed = self._book.memory.removed
        seen = 0
        for state in fleet.states:
            name = state.serial_number
            watch = watches.get(name)
            if watch is None:
                watch = watches[name] = Watch(state, step, now_s, self._book.profile.limits)
                kind = self._book.profiles.robot_types.get(state.robot_type)
                watch.know(kind, self._book.profile.limits)
                watch.look()
            elif name in removed:
                if not removed[name]:
                    continue  # a state from before it was taken away
                self._return(name)
                watch = watches[name]
                watch.see(state, step, now_s, chargers)
            else:
                watch.see(state, step, now_s, chargers)
                if watch.still_steps >= watch.limits.blocked_steps:
                    self._look_ahead(watch)
            seen += 1
        if seen + len(removed) != len(watches):
            for name, watch in watches.items():
                if watch.step != step and name not in removed and watch.missing_s is None:
                    watch.miss(now_s)
                    self._book.is_dirty = True

    def expect(self, orders: FleetOrders) -> None:
        """The newest orders."""
        ordered = {order.serial_number: order for order in orders.orders}
        for name, watch in self._watches.items():
            watch.expect(ordered.get(name))

    def know(self, tasks: Tasks) -> None:
        """The newest tasks."""
        self._book.tasks = tasks

    def operate(self, command: OperatorCommand, now_s: float) -> None:
        """What a person orders; the same `command_id` again does nothing."""
        memory = self._book.memory
        if command.command_id in memory.commands:
            return
        memory.commands.append(command.command_id)
        del memory.commands[:-COMMANDS_KEPT]
        self._book.is_dirty = self._book.is_stirred = True
        match command.command:
            case 'pause':
                memory.paused = memory.paused or 'paused by the operator'
            case 'resume' if not memory.violation:
                memory.paused = ''
                self._fleet_signs.clear(VIOLATION)
                self._book.end_violation(now_s)
            case 'acknowledge':
                self._acknowledge()
            case 'repairRobot' if command.robot in self._watches:
                self._watches[command.robot].forget_moves()
            case 'removeRobot' | 'rejoinRobot' if command.robot in self._watches:
                self._move_out_or_in(command, now_s)
            case 'blockCell' if command.cell is not None and command.known:
                self._book.block(command.cell, 'blocked by the operator', now_s, 0.0)
            case 'unblockCell' if command.cell is not None:
                self._book.blocked.pop(command.cell, None)
                memory.block_tries.pop(node_id(command.cell), None)
            case _:
                pass  # what the Monitor has to find out for itself

    def _acknowledge(self) -> None:
        memory = self._book.memory
        memory.violations_seen = [_name(violation) for violation in self._violations]
        if memory.violation:
            memory.violation = ''
            memory.paused = 'a broken rule was acknowledged: waits for resume'

    def _move_out_or_in(self, command: OperatorCommand, now_s: float) -> None:
        name, removed = command.robot, self._book.memory.removed
        if command.command == 'removeRobot':
            self._remove(name, now_s)
        elif name in removed:
            removed[name] = True
        else:
            self._watches[name].forget_moves()
            self._book.memory.rejoining[name] = now_s + self._book.profile.limits.rejoin_s

    def check(self, report: ValidatorReport) -> None:
        """The validator's word: a rule that was broken stops all."""
        if report.violations is self._violations:
            return
        self._violations = report.violations
        memory = self._book.memory
        seen = frozenset(memory.violations_seen)
        new = [violation for violation in report.violations if _name(violation) not in seen]
        if new and not memory.violation:
            first = new[0]
            memory.violation = f'rule broken in step {first.step}: {first.description}'
            self._book.is_dirty = self._book.is_stirred = True

    def is_mine(self, report: FleetReport) -> bool:
        """Whether a report is of this site: of the same map, with the same robots."""
        return not report.robots or memory_of(report).site == self._site

    def restore(self, report: FleetReport) -> None:
        """Go on from the last report of a Monitor that ended."""
        self._book.memory = memory = memory_of(report)
        self._book.step = report.step
        self._floor = report.floor
        for robot in report.robots:
            name = robot.serial_number
            watch = Watch(robot.state, report.step, robot.seen_s, self._book.profile.limits)
            self._watches[name] = watch
            kept = memory.signs.get(name)
            if kept is not None:
                watch.signs.evidence, watch.signs.ends = dict(kept.evidence), dict(kept.ends)
            if name in memory.missing:
                watch.missing_s, watch.ahead = memory.missing[name]
            watch.hold(not robot.can_move)
            watch.signs.changed = True
        kept = memory.signs.get(FLEET)
        if kept is not None:
            self._fleet_signs.evidence = dict(kept.evidence)
        self._book.blocked = {blocked.cell: blocked for blocked in report.blocked}
        # They may have been said, or not: said twice they are known to be the same.
        self._book.events = list(memory.events)
        self._book.is_dirty = self._book.is_stirred = True

    # Judgement

    def judge(
        self, now_s: float, profiles: ExecutionProfiles, failure_profile: RobotFailureProfile
    ) -> Judgement:
        """What is to be said and done now."""
        self._take_profiles(profiles, failure_profile)
        self._watch_time(now_s)
        self._find_out(now_s)
        memory = self._book.memory
        if memory.failures:
            self._responder.respond(now_s)
        if self._book.is_stirred:
            self._stand(now_s)
        halted = memory.violation or memory.paused
        if halted or self._book.is_stirred or memory.paused_robots:
            self._pauses.tell(bool(halted), now_s)
        self._book.is_stirred = False
        events = tuple(self._book.events)
        self._book.events.clear()
        report = self._report(halted, events)
        actions = InstantActions(tuple(self._book.actions))
        self._book.actions.clear()
        return Judgement(report, actions, events)

    def _find_out(self, now_s: float) -> None:
        """Diagnose all evidence that has changed."""
        violation = self._book.memory.violation
        if violation and VIOLATION not in self._fleet_signs:
            self._fleet_signs.show(VIOLATION, 'violation', violation)
        for name, watch in self._watches.items():
            if watch.signs.changed:
                self._book.diagnose(name, watch.signs, now_s)
        if self._fleet_signs.changed:
            self._book.diagnose(FLEET, self._fleet_signs, now_s)
        if self._book.memory.rejoining:
            self._book.rejoin(now_s)

    def _take_profiles(
        self, profiles: ExecutionProfiles, failure_profile: RobotFailureProfile
    ) -> None:
        if profiles is self._book.profiles and failure_profile is self._book.profile:
            return
        self._book.profiles, self._book.profile = profiles, failure_profile
        for watch in self._watches.values():
            watch.know(profiles.robot_types.get(watch.state.robot_type), failure_profile.limits)
            watch.signs.changed = True  # the table may say something else now
        self._fleet_signs.changed = True

    def _watch_time(self, now_s: float) -> None:
        """What shows by time alone."""
        limits = self._book.profile.limits
        for watch in self._watches.values():
            if watch.signs.ends:
                watch.signs.expire(now_s)
            if watch.missing_s is not None:
                watch.is_silent(now_s)
        if self._fleet_seen_s is not None:
            silent_s = now_s - self._fleet_seen_s
            if silent_s < limits.fleet_silent_s:
                self._fleet_signs.clear(CONTACT)
            elif CONTACT not in self._fleet_signs:
                text = f'no state of the fleet for {silent_s:.1f} s'
                self._fleet_signs.show(CONTACT, 'fleet_silent', text, silent_s=silent_s)
        if self._book.memory.failures or self._book.step % LOOK_STEPS == 0:
            self._look_at_tasks(now_s)
            self._book.open_again(now_s)

    def _look_at_tasks(self, now_s: float) -> None:
        tasks = self._book.tasks
        if tasks is not None:
            limit_s = self._book.profile.limits.task_blocked_s
            self._task_watch.look(tasks, self._watches, self._fleet_signs, now_s, limit_s)
            if any(failure.tasks for failure in self._book.memory.failures):
                self._book.follow_tasks({task.task_id: task for task in tasks.tasks}, now_s)
        halted = self._book.memory.paused or self._book.memory.violation
        for watch in self._watches.values():
            if halted:
                watch.progress_s = now_s
            else:
                watch.is_stuck(now_s)

    def _look_ahead(self, watch: Watch) -> None:
        """Whether it is a robot that stands in the way: then that one is the one to look at."""
        if NO_PROGRESS in watch.signs or not watch.ahead:
            return
        cell = node_cell(watch.ahead)
        if not any(
            cell in other.state.cells for other in self._watches.values() if other is not watch
        ):
            watch.block()

    # Robots that leave and come back

    def _remove(self, name: str, now_s: float) -> None:
        self._book.memory.removed[name] = False
        self._book.memory.rejoining.pop(name, None)
        watch = self._watches[name]
        for key in list(watch.signs.evidence):
            watch.signs.clear(key)
        watch.signs.changed = False
        watch.missing_s = None
        failures = [one for one in self._book.memory.failures if one.robot == name]
        for failure in failures:
            self._book.resolve(failure, 'the robot was taken off the floor', now_s)

    def _return(self, name: str) -> None:
        """A robot that was taken off the floor is on it again, as told."""
        del self._book.memory.removed[name]
        watch = self._watches[name]
        # What it was before it went says nothing of what it is now.
        watch.missing_s = watch.seen_s
        watch.state = msgspec.structs.replace(watch.state, header_id=0, order_id='')
        self._book.is_dirty = self._book.is_stirred = True

    # What goes out

    def _stand(self, now_s: float) -> None:
        """Work out anew how each robot stands."""
        self._standings = standings_of(self._watches, self._book.memory, now_s)
        for name, watch in self._watches.items():
            watch.hold(not self._standings.get(name, WELL).can_move)

    def _report(self, halted: str, events: tuple[FailureEvent, ...]) -> FleetReport:
        if self._book.is_dirty or self._book.memory.events:
            self._remember(events)
        standings = self._standings
        robots = []
        for name, watch in self._watches.items():
            standing = standings.get(name)
            if standing is None and watch.missing_s is None:
                robots.append(RobotReport(name, watch.state, watch.seen_s))
            else:
                robots.append(report_of(watch, standing or WELL))
        return FleetReport(
            self._book.step,
            tuple(robots),
            tuple(self._book.blocked.values()) if self._book.blocked else (),
            halted,
            tuple(node_cell(node) for node in self._book.memory.charger_until),
            self._floor,
            self._memory_text,
        )

    def _remember(self, events: tuple[FailureEvent, ...]) -> None:
        self._book.is_dirty = False
        memory = self._book.memory
        memory.site = self._site
        memory.events = list(events)
        memory.missing = {
            name: (watch.missing_s, watch.ahead)
            for name, watch in self._watches.items()
            if watch.missing_s is not None
        }
        memory.signs = {
            name: SignsKept(signs.evidence, signs.ends)
            for name, signs in chain(
                ((name, watch.signs) for name, watch in self._watches.items()),
                ((FLEET, self._fleet_signs),),
            )
            if signs.evidence
        }
        self._memory_text = msgspec.json.encode(memory).decode()


def _name(violation: Violation) -> str:
    return f'{violation.step}:{violation.rule}:{",".join(violation.robots)}'
