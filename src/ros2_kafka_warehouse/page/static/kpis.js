// The strip of key figures.

import { $, h, keyed, setAttr, setText, show } from './shared/dom.js';
import { SHARES, number, percent, shortSpan, span } from './words.js';

function tiles(kpis, validator) {
  const violations = validator?.broken ?? 0;
  const trouble = (kpis.lost ?? 0) + (kpis.duplicated ?? 0);
  return [
    { id: 'orders', label: 'Orders an hour', value: number(kpis.ordersPerHour), note: `${kpis.delivered ?? 0} of ${kpis.received ?? 0} delivered` },
    { id: 'on-time', label: 'On time', value: percent(kpis.onTime), note: kpis.meanLateS > 0.5 ? `late by ${span(kpis.meanLateS)} on average` : 'with a due time' },
    { id: 'cycle', label: 'Cycle time, 95th', value: span(kpis.cycleP95S), note: `median ${span(kpis.cycleP50S)}` },
    { id: 'hand-over', label: 'Hand-over time', value: shortSpan(kpis.handOverS), note: `${kpis.handOvers ?? 0} after failures` },
    { id: 'deadlocks', label: 'Deadlocks', value: number(kpis.deadlocks ?? 0), note: `${kpis.stuck ?? 0} given way now`, bad: kpis.deadlocks > 0 },
    { id: 'lost', label: 'Lost, duplicated', value: `${kpis.lost ?? 0}, ${kpis.duplicated ?? 0}`, note: 'orders and lines', bad: trouble > 0 },
    { id: 'planner', label: 'Planner', value: kpis.plannerP50Ms == null ? '–' : `${number(kpis.plannerP50Ms, 1)} ms`, note: `at most ${number(kpis.plannerMaxMs, 1)} ms` },
    { id: 'validator', label: 'Rules broken', value: validator ? number(violations) : '–', note: validator ? `${(validator.checked ?? 0).toLocaleString('en')} steps checked` : 'no validator heard', bad: violations > 0 },
  ];
}

function makeTile() {
  return h('div', { class: 'tile' }, h('h3'), h('p', { class: 'value' }), h('p', { class: 'note' }));
}

function updateTile(node, tile) {
  const [label, value, note] = node.children;
  setText(label, tile.label);
  setText(value, tile.value);
  setText(note, tile.note);
  setAttr(node, 'data-kpi', tile.id);
  node.classList.toggle('bad', Boolean(tile.bad));
}

function makeShares() {
  const bar = h('div', { class: 'bar', role: 'img' });
  const legend = h('ul');
  for (const name of Object.keys(SHARES)) {
    bar.append(h('span', { class: `share ${name}` }));
    legend.append(h('li', {}, h('i', { class: `share ${name}` }), h('span')));
  }
  return h('div', { class: 'tile shares' }, h('h3', {}, 'Use of the robots'), bar, legend);
}

export function drawKpis(kpis, validator) {
  const parent = $('kpis');
  const list = [...tiles(kpis, validator), { id: 'shares', shares: kpis.shares ?? {} }];
  keyed(parent, list, (tile) => tile.id,
    (tile) => (tile.shares ? makeShares() : makeTile()),
    (node, tile) => (tile.shares ? updateShares(node, tile.shares) : updateTile(node, tile)));
}

function updateShares(node, shares) {
  const [, bar, legend] = node.children;
  const said = [];
  Object.entries(SHARES).forEach(([name, word], index) => {
    const share = shares[name] ?? 0;
    const part = bar.children[index];
    part.style.flexGrow = share;
    show(part, share > 0);
    setText(legend.children[index].lastChild, `${word} ${percent(share)}`);
    said.push(`${word} ${percent(share)}`);
  });
  setAttr(bar, 'aria-label', said.join(', '));
}
