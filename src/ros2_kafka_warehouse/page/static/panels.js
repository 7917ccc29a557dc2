// The tables of orders and robots, and the timeline of failures.

import { $, h, keyed, setAttr, setChip, setText, show } from './shared/dom.js';
import { causeWord, clock, codeWord, eventWord, orderState, robotState, shortSpan, span } from './words.js';

// Orders

const opened = new Set();

export function drawOrders(section, kind, nowS) {
  const rows = kind === 'open' ? sortOpen(section.open) : section.ended;
  setText($('orders-open'), `Open ${section.openCount ?? 0}`);
  setText($('orders-ended'), `Ended ${section.ended.length}`);
  const table = $('orders');
  if (table.kind !== kind) {
    table.replaceChildren(h('thead', {}, h('tr', {}, ...['Order', 'Status', 'Lines', kind === 'open' ? 'Due in' : 'Ended', kind === 'open' ? 'ETA' : 'Took', 'Late']
      .map((word, index) => h('th', { scope: 'col', class: index > 2 ? 'number' : '' }, word)))));
    table.kind = kind;
    table.kept = new Map();
  }
  const first = table.tHead.nextElementSibling;
  keyed(table, rows, (row) => row.id, makeOrder, (node, row) => updateOrder(node, row, nowS), first);
  emptyNote(table, rows.length, kind === 'open' ? 'No open orders. Send one with “New order”.' : 'No order has ended yet.');
}

function sortOpen(rows) {
  const urgency = (row) => row.dueS ?? Infinity;
  return [...rows].sort((a, b) => (b.status === 'BLOCKED') - (a.status === 'BLOCKED') || urgency(a) - urgency(b) || (a.releasedS ?? 0) - (b.releasedS ?? 0));
}

function makeOrder(row) {
  const id = `lines-of-${row.id}`;
  const button = h('button', { type: 'button', class: 'row-name', 'aria-expanded': 'false', 'aria-controls': id });
  const bar = h('span', { class: 'progress' }, h('span'));
  const first = h('tr', { class: 'row' },
    h('td', {}, button, h('span', { class: 'sub' })), h('td', {}, h('span', { class: 'chip' })),
    h('td', {}, bar, h('span', { class: 'sub' })), h('td', { class: 'number' }), h('td', { class: 'number' }), h('td', { class: 'number' }));
  const second = h('tr', { class: 'more', id, hidden: true }, h('td', { colSpan: 6 }, h('p', { class: 'full' }, row.id), h('p', { class: 'reason' }), h('ul', { class: 'lines' })));
  const body = h('tbody', {}, first, second);
  first.addEventListener('click', () => {
    if (!opened.delete(row.id)) opened.add(row.id);
    openOrder(body, row.id);
  });
  return body;
}

function openOrder(body, id) {
  const open = opened.has(id);
  const button = body.querySelector('button');
  setAttr(button, 'aria-expanded', open);
  show(body.children[1], open);
}

function updateOrder(body, row, nowS) {
  const [first, second] = body.children;
  const [name, status, lines, due, eta, late] = first.children;
  setText(name.firstChild, row.id);
  setAttr(name.firstChild, 'title', row.id);
  setText(name.lastChild, [row.station, row.priority ? `priority ${row.priority}` : ''].filter(Boolean).join(', '));
  const [word, tone] = orderState(row.status);
  setChip(status.firstChild, word, tone);
  const all = row.lines ?? [];
  const done = all.filter((line) => line.status === 'DELIVERED').length;
  setText(lines.lastChild, `${done} of ${all.length}`);
  lines.firstChild.firstChild.style.width = all.length ? `${(100 * done) / all.length}%` : '0';
  const open = row.endedS === undefined || row.endedS === null;
  setText(due, open ? signed(row.dueS, nowS) : clock(row.endedS));
  setText(eta, open ? (etaOf(row, nowS) == null ? '–' : span(Math.max(0, row.etaS - nowS))) : (row.releasedS == null ? '–' : span(row.endedS - row.releasedS)));
  const lateS = open ? foreseen(row, nowS) : row.lateS;
  setText(late, lateS == null ? '–' : lateS > 0.5 ? `+${span(lateS)}` : open ? 'on time' : `−${span(lateS)}`);
  late.classList.toggle('late', lateS > 0.5);
  openOrder(body, row.id);
  if (opened.has(row.id)) updateLines(second.firstChild, row);
}

const signed = (timeS, nowS) => (timeS == null ? '–' : (timeS < nowS ? '−' : '') + span(timeS - nowS));

// An arrival further off than a day is none: nobody can deliver it now.
const etaOf = (row, nowS) => (row.etaS != null && row.etaS - nowS < 86400 ? row.etaS : null);

function foreseen(row, nowS) {
  if (row.dueS == null) return null;
  const eta = etaOf(row, nowS);
  if (eta == null && nowS <= row.dueS) return null; // nobody can say yet
  return Math.max(nowS, eta ?? nowS) - row.dueS;
}

function updateLines(cell, row) {
  const [, reason, list] = cell.children;
  setText(reason, row.reason ?? '');
  show(reason, Boolean(row.reason));
  keyed(list, row.lines ?? [], (line) => line.id,
    () => h('li', {}, h('span', { class: 'what' }), h('span', { class: 'chip' }), h('span', { class: 'sub' })),
    (node, line) => {
      setText(node.children[0], `${line.quantity} × ${line.product}`);
      setChip(node.children[1], ...orderState(line.status));
      setText(node.children[2], [line.robot, line.reason].filter(Boolean).join(': '));
    });
}

// Robots

const STATE_ORDER = { failed: 0, silent: 1, removed: 2 };

export function drawRobots(robots, selected, onSelect) {
  const table = $('robots');
  if (!table.kept) {
    table.append(h('thead', {}, h('tr', {}, ...['Robot', 'State', 'Battery', 'Load', 'Failure and answer'].map((word) => h('th', { scope: 'col' }, word)))));
    table.append(h('tbody'));
    table.kept = true;
  }
  const rows = [...robots].sort((a, b) => (STATE_ORDER[a.status] ?? 9) - (STATE_ORDER[b.status] ?? 9) || byName(a.id, b.id));
  keyed(table.lastElementChild, rows, (row) => row.id, (row) => makeRobot(row, onSelect), (node, row) => updateRobot(node, row, selected));
  const failed = rows.filter((row) => robotState(row.status).share === 'failed').length;
  setText($('robots-count'), rows.length ? `${rows.length}${failed ? `, ${failed} not working` : ''}` : 'none heard yet');
}

const collator = new Intl.Collator('en', { numeric: true });
const byName = (a, b) => collator.compare(a, b);

function makeRobot(row, onSelect) {
  const node = h('tr', { class: 'row' },
    h('td', {}, h('button', { type: 'button', class: 'row-name' }, row.id), h('span', { class: 'sub' }, row.type)),
    h('td', {}, h('span', { class: 'state' }, h('i'), h('span'))),
    h('td', {}, h('span', { class: 'battery' }, h('span')), h('span', { class: 'sub' })),
    h('td'), h('td', {}, h('p', {}, h('span'), h('span', { class: 'sub' }))));
  node.addEventListener('click', () => onSelect(row.id));
  return node;
}

function updateRobot(node, row, selected) {
  const [, state, battery, load, failure] = node.children;
  node.classList.toggle('selected', row.id === selected);
  const { word, share } = robotState(row.status);
  setAttr(state.firstChild.firstChild, 'class', `share ${share}`);
  setText(state.firstChild.lastChild, row.paused && share !== 'failed' ? `${word}, paused` : word);
  battery.firstChild.firstChild.style.width = `${row.battery}%`;
  battery.firstChild.classList.toggle('low', row.battery < 25);
  setText(battery.lastChild, `${Math.round(row.battery)} %`);
  setText(load, row.load ? `${row.loadKg ?? 0} kg` : '–');
  const [what, answer] = failure.firstChild.children;
  setText(what, row.failure ? codeWord(row.failure) : '');
  what.className = row.failure ? 'failure' : '';
  setText(answer, row.answer ?? '');
  setAttr(failure, 'title', row.answer ?? '');
}

// Failures

export function drawFailures(failures, onSelect) {
  const list = $('failures');
  const open = failures.filter((failure) => failure.endedS == null).length;
  setText($('failures-count'), failures.length ? `${open} open, ${failures.length} in all` : '');
  const rows = [...failures].sort((a, b) => (a.endedS != null) - (b.endedS != null));
  keyed(list, rows, (failure) => failure.id, (failure) => makeFailure(failure, onSelect), updateFailure);
  emptyNote(list, failures.length, 'Nothing has failed. Select a robot on the floor to try it.');
}

function makeFailure(failure, onSelect) {
  const where = failure.robot
    ? h('button', { type: 'button', class: 'link', onclick: () => onSelect(failure.robot) }, failure.robot)
    : h('span', {}, failure.cell ? `Cell ${failure.cell.join(', ')}` : 'The floor');
  return h('li', { class: 'card' },
    h('div', { class: 'when' }, h('time'), h('span', { class: 'sub' })),
    h('div', { class: 'what' },
      h('p', { class: 'title' }, h('strong'), ' ', where, ' ', h('span', { class: 'chip' })),
      h('p', { class: 'cause' }),
      h('ol', { class: 'steps' })));
}

function updateFailure(node, failure) {
  const [when, what] = node.children;
  const [title, cause, steps] = what.children;
  const over = failure.endedS != null;
  node.classList.toggle('over', over);
  setText(when.firstChild, clock(failure.sinceS));
  setText(when.lastChild, over ? `over in ${shortSpan(failure.endedS - failure.sinceS)}` : 'open');
  setText(title.firstChild, codeWord(failure.code || 'not judged yet'));
  setChip(title.lastChild, over ? 'Over' : (failure.level || 'Open').toLowerCase(), over ? 'good' : tone(failure.level));
  setText(cause, failure.cause ? `Cause: ${causeWord(failure.cause)}` : '');
  show(cause, Boolean(failure.cause));
  const said = (failure.steps ?? []).filter((step) => step.event !== 'FailureDiagnosed');
  keyed(steps, said.map((step, index) => ({ ...step, index })), (step) => step.index,
    () => h('li', {}, h('span', { class: 'after' }), h('span', { class: 'event' }), h('span')),
    (item, step) => {
      setText(item.children[0], `+${shortSpan(step.timeS - failure.sinceS)}`);
      setText(item.children[1], eventWord(step.event));
      setText(item.children[2], step.text ?? '');
    });
}

const tone = (level) => (level === 'FATAL' || level === 'CRITICAL' ? 'bad' : level === 'URGENT' ? 'warn' : 'calm');

function emptyNote(node, count, text) {
  const scroll = node.parentElement;
  let note = scroll.querySelector('.empty');
  if (!note) {
    note = h('p', { class: 'empty' }, text);
    scroll.append(note);
  }
  setText(note, text);
  show(note, count === 0);
}
