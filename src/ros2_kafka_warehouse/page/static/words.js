// How states, times and numbers are said to people.

export const WALL = '@'; // or a shelf, in the rows of a site

const ROBOT_STATES = {
  carrying: { word: 'Carrying', share: 'working' },
  picking: { word: 'Picking', share: 'working' },
  dropping: { word: 'Dropping', share: 'working' },
  travelling: { word: 'Travelling', share: 'travelling' },
  waiting: { word: 'Waiting', share: 'waiting' },
  idle: { word: 'Idle', share: 'idle' },
  charging: { word: 'Charging', share: 'charging' },
  silent: { word: 'Silent', share: 'failed' },
  failed: { word: 'Failed', share: 'failed' },
  removed: { word: 'Off the floor', share: 'failed' },
};

export const SHARES = {
  working: 'Working',
  travelling: 'Travelling',
  waiting: 'Waiting',
  idle: 'Idle',
  charging: 'Charging',
  failed: 'Failed',
};

const ORDER_STATES = {
  RECEIVED: ['Received', 'calm'],
  PLANNED: ['Planned', 'calm'],
  OPEN: ['Open', 'calm'],
  ASSIGNED: ['Assigned', 'calm'],
  PICKING: ['Picking', 'busy'],
  CARRYING: ['Carrying', 'busy'],
  CARRIED: ['Carrying', 'busy'],
  BLOCKED: ['Blocked', 'bad'],
  DELIVERED: ['Delivered', 'good'],
  PARTIAL: ['Partial', 'warn'],
  CANCELLED: ['Cancelled', 'calm'],
  FAILED: ['Failed', 'bad'],
  REJECTED: ['Rejected', 'bad'],
};

const EVENTS = {
  FailureDetected: 'Seen',
  FailureDiagnosed: 'Judged',
  ResponseOrdered: 'Answer',
  TaskReassigned: 'New robot',
  FailureEscalated: 'Escalated',
  FailureResolved: 'Over',
};

const CAUSES = {
  communications: 'communications',
  control: 'the robot’s control system',
  design: 'the design of the robot or the floor',
  effector: 'motor, wheels or gripper',
  external: 'something outside the robot',
  human: 'a person',
  power: 'power supply or battery',
  sensor: 'a sensor',
  software: 'software',
  unknown: 'not known',
};

export const causeWord = (name) => CAUSES[name] ?? name;

export const eventWord = (name) => EVENTS[name] ?? name;

export const orderState = (name) => ORDER_STATES[name] ?? [name || 'Unknown', 'calm'];

export const robotState = (name) => ROBOT_STATES[name] ?? { word: name, share: 'idle' };

// MOTION_FAULT -> Motion fault
export function codeWord(code) {
  const words = code.toLowerCase().replaceAll('_', ' ');
  return words.charAt(0).toUpperCase() + words.slice(1);
}

export function span(seconds) {
  if (seconds === null || seconds === undefined || Number.isNaN(seconds)) return '–';
  const s = Math.abs(Math.round(seconds));
  if (s < 60) return `${s} s`;
  if (s < 3600) return `${Math.floor(s / 60)}:${String(s % 60).padStart(2, '0')}`;
  return `${Math.floor(s / 3600)} h ${String(Math.floor((s % 3600) / 60)).padStart(2, '0')}`;
}

export function shortSpan(seconds) {
  if (seconds === null || seconds === undefined) return '–';
  return Math.abs(seconds) < 10 ? `${seconds.toFixed(1)} s` : span(seconds);
}

const clockFormat = new Intl.DateTimeFormat('en-GB', {
  hour: '2-digit', minute: '2-digit', second: '2-digit',
});

export function clock(seconds) {
  const time = new Date(seconds * 1000);
  return Number.isNaN(time.getTime()) ? '–' : clockFormat.format(time); // anybody may send one
}

export function number(value, digits = 0) {
  return value === null || value === undefined ? '–' : value.toFixed(digits);
}

export function percent(share) {
  return share === null || share === undefined ? '–' : `${Math.round(share * 100)} %`;
}

export function plural(count, one, many = `${one}s`) {
  return `${count} ${count === 1 ? one : many}`;
}
