"""The driver of one real robot, in plain rclpy: where its own commands belong is marked.

Run `make warehouse A='--robots 1 --without robots'`, and this beside; or a site file of your own
that lists the robot. It speaks for all robots of the site: here there is one.
"""

import argparse
import json
from contextlib import suppress
from typing import Any

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String

# Ten: a latched writer that keeps one message can fall silent when a reader is killed.
LATCHED = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
ENDED_KEPT = 10
AFTER_A_RESTART = 10  # steps that are left out: nobody may take a new state for an old one
SETTLE_S = 0.7
BATTERY_PER_CELL, BATTERY_PER_STEP = 0.05, 0.4  # percent


class RobotDriver(Node):
    """Hears orders and instant actions, says the state of the fleet once a step."""

    def __init__(self, options: argparse.Namespace) -> None:
        super().__init__('robots')
        column, row = options.home.split(',')
        self.step = self.moved = 0
        self.order: dict[str, Any] = {}
        self.step_s = options.step_s
        self.state: dict[str, Any] = {
            'headerId': 0,
            'serialNumber': options.serial_number,
            'robotType': options.type,
            'lastNodeId': options.home,
            'position': {'x': int(column) + 0.5, 'y': int(row) + 0.5},
            'powerSupply': {'stateOfCharge': 100.0, 'charging': False},
            'actionStates': [],
            'loads': [],
        }
        self.states = self.create_publisher(String, '/robots/state', LATCHED)
        self.create_subscription(String, '/robots/orders', self.hear_orders, 10)
        self.create_subscription(String, '/robots/instant_actions', self.hear_actions, 10)
        self.create_subscription(String, '/monitor/fleet', self.hear_fleet, LATCHED)
        self.report: dict[str, Any] = {}
        self.timer: Any = None

    def hear_fleet(self, message: String) -> None:
        """Begin soon, with the newest: a latched writer sends all that it keeps, oldest first."""
        self.report = json.loads(message.data)
        if self.timer is None:
            self.timer = self.create_timer(SETTLE_S, self.begin)

    def begin(self) -> None:
        """Go on with the count of steps that the Monitor remembers, and with the load."""
        for robot in self.report.get('robots', ()):
            if robot['serialNumber'] == self.state['serialNumber']:
                # A real robot asks its own sensors where it is and what it carries.
                self.state = {'actionStates': [], 'loads': [], **robot['state']}
                self.step = self.report['step'] + AFTER_A_RESTART
        self.timer.cancel()
        self.timer = self.create_timer(self.step_s, self.take_a_step)

    def hear_orders(self, message: String) -> None:
        """Keep the newest order; one that was planned before it moved is void."""
        orders = json.loads(message.data)
        mine = [
            order
            for order in orders.get('orders', ())
            if order['serialNumber'] == self.state['serialNumber']
        ]
        self.order = mine[0] if mine and orders['step'] >= self.moved else {}

    def hear_actions(self, message: String) -> None:
        """Do at once what cannot wait."""
        for action in json.loads(message.data)['actions']:
            if action['serialNumber'] != self.state['serialNumber']:
                continue
            match action['actionType']:
                case 'startPause' | 'stopPause':
                    self.state['paused'] = action['actionType'] == 'startPause'
                case 'cancelOrder':
                    self.order, self.state['orderId'] = {}, ''
                case 'stopCharging':
                    self.state['powerSupply']['charging'] = False

    def take_a_step(self) -> None:
        """Do what is ordered, as far as one step goes, and say what has become of it."""
        self.step += 1
        # A release holds for one step: the next order says anew.
        order, self.order = self.order, {}
        if order and order['nodes'] and not self.state.get('paused'):
            self.obey(order)
        power = self.state['powerSupply']
        if power.get('charging'):
            power['stateOfCharge'] = min(100.0, power['stateOfCharge'] + BATTERY_PER_STEP)
        self.state['headerId'] += 1
        fleet = {'step': self.step, 'states': [self.state]}
        self.states.publish(String(data=json.dumps(fleet)))

    def obey(self, order: dict[str, Any]) -> None:
        """Do the actions of the node where it stands; drive to the next one, if it may."""
        here, *ahead = order['nodes']
        if here['nodeId'] != self.state['lastNodeId']:
            return
        self.state['orderId'] = order['orderId']
        self.state['orderUpdateId'] = order['orderUpdateId']
        self.state['lastNodeSequenceId'] = here['sequenceId']
        done = {action['actionId'] for action in self.state['actionStates']}
        for action in here.get('actions', ()):
            if action['actionType'] == 'startCharging' or action['actionId'] not in done:
                self.act(action)
        if ahead and ahead[0].get('released', True):
            self.drive_to(ahead[0])

    def drive_to(self, node: dict[str, Any]) -> None:
        """Drive to a node that is next to it. Your robot's own drive command belongs here.

        A robot that takes longer than a step says `driving` and the node in `nodeStates`, and its
        `lastNodeId` stays what it was, until it is there.
        """
        column, row = node['nodeId'].split(',')
        self.state['lastNodeId'] = node['nodeId']
        self.state['lastNodeSequenceId'] = node['sequenceId']
        self.state['position'] = {'x': int(column) + 0.5, 'y': int(row) + 0.5}
        power = self.state['powerSupply']
        power['charging'] = False
        power['stateOfCharge'] = max(0.0, power['stateOfCharge'] - BATTERY_PER_CELL)
        self.moved = self.step

    def act(self, action: dict[str, Any]) -> None:
        """Pick, drop or charge. Your robot's gripper and plug belong here."""
        carried = [load['loadId'] for load in self.state['loads']]
        match action['actionType']:
            case 'pick' if not carried:
                load = {'loadId': action['loadId'], 'loadType': action.get('product', '')}
                self.state['loads'] = [{**load, 'weight': action.get('weightKg', 0.0)}]
            case 'drop' if action['loadId'] in carried:
                self.state['loads'] = []
            case 'startCharging':
                self.state['powerSupply']['charging'] = True
            case _:
                self.note(action, 'FAILED')
                return
        self.note(action, 'FINISHED')

    def note(self, action: dict[str, Any], status: str) -> None:
        """Keep the last ten actions that ended, so that nobody misses an end."""
        ended = {name: action[name] for name in ('actionId', 'actionType')}
        before = [
            other
            for other in self.state['actionStates']
            if other['actionId'] != action['actionId']
        ]
        self.state['actionStates'] = [*before, {**ended, 'actionStatus': status}][-ENDED_KEPT:]


if __name__ == '__main__':
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--serial-number', default='carrier-01')
    parser.add_argument('--type', default='carrier', help='One of the execution profiles.')
    parser.add_argument('--home', default='0,0', help='Column,row of the cell where it stands.')
    parser.add_argument('--step-s', type=float, default=0.5)
    arguments = parser.parse_args()
    with suppress(KeyboardInterrupt, ExternalShutdownException), rclpy.init():
        rclpy.spin(RobotDriver(arguments))
