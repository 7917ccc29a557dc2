// Numbers, times and states in words.

const whole = new Intl.NumberFormat('en');

export const count = (n) => (n === null || n === undefined ? '–' : whole.format(Math.round(n)));
export const counted = (n, thing) => `${count(n)} ${thing}${n === 1 ? '' : 's'}`;

export function rate(n) {
  if (n === null || n === undefined) return '–';
  if (n === 0) return '0';
  return n < 10 ? n.toFixed(1) : count(n);
}

export function bytes(n) {
  if (n === null || n === undefined) return '–';
  const units = ['B', 'KiB', 'MiB', 'GiB', 'TiB'];
  let unit = 0;
  while (n >= 1024 && unit < units.length - 1) [n, unit] = [n / 1024, unit + 1];
  return `${unit && n < 100 ? n.toFixed(1) : Math.round(n)} ${units[unit]}`;
}

export function seconds(s) {
  if (s === null || s === undefined) return '–';
  if (s >= 300) return '> 5 min';
  if (s >= 10) return `${Math.round(s)} s`;
  if (s >= 1) return `${s.toFixed(1)} s`;
  const ms = s * 1000;
  return ms >= 10 ? `${Math.round(ms)} ms` : `${ms.toFixed(1)} ms`;
}

export function span(s) {
  if (s < 90) return `${Math.max(0, Math.round(s))} s`;
  if (s < 5400) return `${Math.round(s / 60)} min`;
  if (s < 172800) return `${Math.floor(s / 3600)} h ${Math.round((s % 3600) / 60)} min`;
  return `${Math.floor(s / 86400)} d ${Math.round((s % 86400) / 3600)} h`;
}

export function clock(s) {
  const at = new Date(s * 1000);
  const today = new Date().toDateString() === at.toDateString();
  const time = at.toLocaleTimeString('en-GB');
  return today ? time : `${at.getFullYear()}-${pad(at.getMonth() + 1)}-${pad(at.getDate())} ${time}`;
}
const pad = (n) => String(n).padStart(2, '0');

export const TONES = {
  running: 'good', waiting: 'warn', paused: 'busy', starting: 'calm', failed: 'bad', stopped: 'calm',
};
export const ORDER = ['failed', 'stopped', 'starting', 'waiting', 'paused', 'running'];
export const OUTCOMES = {
  confirmed: 'confirmed', published: 'published, not confirmed', dead_lettered: 'dead-lettered',
  dropped: 'dropped', skipped: 'skipped (own records)',
  returned: 'returned at a rebalance', lost: 'lost on a damaged disk', given_up: 'given up at a take-over',
};
// What a route from ROS holds; not known while its disk is not.
export const onItsWay = (route) => (route.spooled === null || route.in_flight === null ? null : route.in_flight + route.spooled);
// Of all that is known of these, and how much is not.
export function sum(list, read) {
  const known = list.map(read).filter((it) => it !== null);
  return { total: known.length ? known.reduce((total, it) => total + it, 0) : null, rest: list.length - known.length };
}
export const readsKafka = (it) => it?.direction === 'kafka_to_ros';
export const reading = (about) => new Set(about.filter(readsKafka).map((it) => it.name));
export const arrow = (about) => (about ? `${about.source} → ${about.sink}` : '');
