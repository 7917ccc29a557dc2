"""The failures that a person can put into a robot, in words."""

from typing import Final

FAILURES: Final = {
    'MOTION_FAULT': 'Motor or wheel fails',
    'LOCALIZATION_ERROR': 'Loses its position',
    'COMM_LOST': 'Connection is lost',
    'SOFTWARE_CRASH': 'Software crashes and starts anew',
    'EMERGENCY_STOP': 'Emergency stop is pressed',
    'FIELD_VIOLATION': 'Somebody is in its safety field',
    'PATH_BLOCKED': 'Something stands in its way',
    'NODE_UNREACHABLE': 'Finds no way on',
    'STALLED': 'Hardly moves',
    'DELAYED': 'Drives at half speed',
    'OFF_PLAN': 'Drives where it should not',
    'OUTSIDE_OF_CORRIDOR': 'Leaves the corridor of its path',
    'LOW_BATTERY': 'Battery is low',
    'BATTERY_CRITICAL': 'Battery is nearly empty',
    'BATTERY_DEPLETED': 'Battery is empty',
    'CHARGER_FAULT': 'Charger gives no current',
    'PICK_FAILED': 'Pick fails',
    'LOAD_MISSING': 'Load is not in its place',
    'LOAD_DROPPED': 'Load slides off',
    'OVERWEIGHT': 'Load is too heavy',
    'MISFIT': 'Load does not fit',
    'ORDER_REJECTED': 'Refuses its order',
    'UNKNOWN': 'Something nobody has seen before',
}
