// The table of routes, the tiles above it, and what needs attention.

import { $, h, keyed, setAttr, setChip, setText, show } from './shared/dom.js';
import { drawSpark, spark } from './spark.js';
import { ORDER, TONES, arrow, bytes, clock, count, counted, onItsWay, rate, reading, seconds, sum } from './words.js';

const RECENT_S = 120;
// Each ends with its one message: no route waits because of them.
const OF_ONE_MESSAGE = new Set(['DecodeError', 'EncodeError', 'LoopError', 'RecordTooLargeError', 'TimestampError']);
const COLUMNS = [
  ['name', 'Route', (r) => r.name],
  ['state', 'State', (r) => ORDER.indexOf(r.state)],
  ['rate', 'Rate /s, last 10 min', (r) => -(r.rate ?? -1)],
  ['latency', 'Delay p50 / p99', (r) => -(r.delay_s?.[1] ?? -1)],
  ['lag', 'Lag', (r) => -(r.lag ?? -1)],
  ['in_flight', 'In flight', (r) => -(onItsWay(r) ?? -1)],
  ['dead', 'Dead letters', (r) => -(r.ended.dead_lettered ?? -1)],
];

export class Routes {
  constructor(history, open, pause) {
    this.history = history;
    this.open = open;
    this.pause = pause;
    this.sort = null;
    this.down = false;
    this.visible = new WeakSet();
    this.observer = new IntersectionObserver((entries) => {
      for (const { target, isIntersecting } of entries) {
        if (isIntersecting) this.visible.add(target);
        else this.visible.delete(target);
      }
    }, { rootMargin: '200px' });
    const table = $('routes');
    this.heads = COLUMNS.map(([key, word]) => h('th', { scope: 'col', class: key },
      h('button', { type: 'button', onclick: () => this.sortBy(key) }, word)));
    table.append(h('thead', {}, h('tr', {}, ...this.heads, h('th', { class: 'do' }, h('span', { class: 'away' }, 'Pause or resume')))));
    table.append(this.body = h('tbody'));
    $('find').oninput = $('which').onchange = () => this.again();
  }

  sortBy(key) {
    if (this.sort !== key) [this.sort, this.down] = [key, false];
    else if (!this.down) this.down = true;
    else this.sort = null;
    this.again();
  }

  again() {
    if (this.view) this.draw(this.view, this.mayChange);
  }

  draw(view, mayChange) {
    [this.view, this.mayChange] = [view, mayChange];
    this.about = new Map(view.about.map((it) => [it.name, it]));
    drawTiles(view);
    this.drawAttention(view);
    COLUMNS.forEach(([key], at) => {
      setAttr(this.heads[at], 'aria-sort', this.sort !== key ? null : this.down ? 'descending' : 'ascending');
    });
    const rows = this.chosen(view.routes);
    setText($('shown'), rows.length === view.routes.length ? '' : `${count(rows.length)} of ${count(view.routes.length)}`);
    keyed(this.body, rows, (it) => it.name, (it) => this.make(it), (node, it) => this.update(node, it));
  }

  chosen(routes) {
    const text = $('find').value.trim().toLowerCase();
    const which = $('which').value;
    const found = routes.filter((it) => {
      if (which === 'attention' ? !needsAttention(it) : which && it.state !== which) return false;
      return !text || `${it.name} ${arrow(this.about.get(it.name))}`.toLowerCase().includes(text);
    });
    const column = COLUMNS.find(([key]) => key === this.sort);
    if (!column) return found;
    const value = column[2];
    found.sort((a, b) => (value(a) > value(b) ? 1 : value(a) < value(b) ? -1 : 0) * (this.down ? -1 : 1));
    return found;
  }

  make(route) {
    const node = h('tr', { class: 'row' });
    const p = node.parts = {
      ends: h('span', { class: 'sub' }),
      state: h('span', { class: 'chip' }),
      spark: spark(120, 24),
      rate: h('span', { class: 'value' }),
      latency: h('span', { class: 'value' }),
      lag: h('span', { class: 'value' }),
      flight: h('span', { class: 'value' }),
      more: h('span', { class: 'sub' }),
      dead: h('span', { class: 'value' }),
      button: h('button', { type: 'button', class: 'small', onclick: () => this.pause(node.route) }),
    };
    const cell = (key, word, ...children) => h('td', { class: key, 'data-word': word }, ...children);
    node.append(
      h('th', { scope: 'row', class: 'name' },
        h('button', { type: 'button', class: 'link', onclick: () => this.open(route.name) }, route.name), p.ends),
      cell('state', '', p.state),
      cell('rate', 'per second', p.spark, p.rate),
      cell('latency', 'p50 / p99', p.latency),
      cell('lag', 'lag', p.lag),
      cell('in_flight', 'in flight', p.flight, p.more),
      cell('dead', 'dead letters', p.dead),
      cell('do', '', p.button),
    );
    this.observer.observe(node);
    return node;
  }

  update(node, route) {
    const p = node.parts;
    node.route = route;
    setText(p.ends, arrow(this.about.get(route.name)));
    setChip(p.state, route.state, TONES[route.state]);
    setAttr(p.state, 'title', route.reason);
    setText(p.rate, rate(route.rate));
    const [p50, p99] = route.delay_s ?? [null, null];
    setText(p.latency, route.delay_s ? `${seconds(p50)} / ${seconds(p99)}` : '–');
    setText(p.lag, count(route.lag));
    setText(p.flight, count(route.in_flight));
    const mayHold = route.spooled === null && this.about.get(route.name)?.spool;
    setText(p.more, route.spooled || mayHold ? `${count(route.spooled)} on disk` : '');
    setText(p.dead, count(route.ended.dead_lettered));
    setAttr(p.dead, 'class', route.ended.dead_lettered ? 'value bad' : 'value');
    const word = route.paused ? 'Resume' : 'Pause';
    setText(p.button, word);
    setAttr(p.button, 'aria-label', `${word} ${route.name}`);
    show(p.button, this.mayChange);
    if (this.visible.has(node)) drawSpark(p.spark, this.history.rates(route.name), this.history.span);
  }

  drawAttention({ routes, troubles, bridge }) {
    // What a route waits for may follow from an error that it has met just before.
    const before = (it) => troubles.find((one) => one.route === it.name && bridge.now_s - one.time_s < RECENT_S
      && !OF_ONE_MESSAGE.has(one.error) && !it.reason.includes(one.text));
    const said = (it) => (before(it) ? ` Last error, ${clock(before(it).time_s)}: ${before(it).text}` : '');
    const chosen = routes.filter(needsAttention);
    chosen.sort((a, b) => ORDER.indexOf(a.state) - ORDER.indexOf(b.state));
    // A route that waits may do so because of what does not match: both are said.
    const found = chosen.flatMap((it) => [
      ...(it.state === 'running' ? [] : [{ ...it, key: it.name }]),
      ...(it.mismatched ? [{ ...it, key: `${it.name} mismatch`, odd: true }] : []),
    ]);
    const most = 6;
    const rows = found.slice(0, most);
    if (found.length > most) rows.push({ key: '…', more: found.length - most });
    keyed($('attention'), rows, (it) => it.key, (it) => {
      const node = h('li');
      const button = h('button', { type: 'button', class: 'link', onclick: () => (it.more ? this.all() : this.open(it.name)) });
      node.parts = [h('span', { class: 'chip' }), button, h('p'), h('p', { class: 'note' })];
      node.append(...node.parts);
      return node;
    }, (node, it) => {
      const [chip, button, reason, todo] = node.parts;
      show(chip, !it.more);
      setText(button, it.more ? `${count(it.more)} more` : it.name);
      if (it.more) return;
      setChip(chip, ...(it.odd ? ['mismatch', 'warn'] : [it.state, TONES[it.state]]));
      const odd = `${counted(it.mismatched, 'DDS endpoint')} on its topic ${it.mismatched === 1 ? 'does' : 'do'} not match it`;
      setText(reason, it.odd ? odd : it.reason || it.state);
      setText(todo, it.odd ? 'The ROS graph shows which, and why.' : it.advice + said(it));
    });
  }

  all() {
    $('which').value = 'attention';
    this.again();
    $('which').focus();
  }
}

function needsAttention(it) {
  return it.state !== 'running' || it.mismatched > 0;
}

function drawTiles(view) {
  const { bridge, broker } = view;
  const tiles = [
    ...(bridge.lifecycle === null ? UNTOLD : ofRoutes(view)),
    ['Kafka', kafkaWord(broker), broker?.problem ? 'look at System' : broker ? `asked in ${seconds(broker.round_trip_s)}` : 'not asked yet', broker?.problem ? 'bad' : ''],
  ];
  keyed($('tiles'), tiles, (it) => it[0], ([word]) => {
    const node = h('div', { class: 'tile' });
    node.parts = [h('p', { class: 'value' }), h('p', { class: 'note' })];
    node.append(h('h2', {}, word), ...node.parts);
    return node;
  }, (node, [, value, note, tone]) => {
    setText(node.parts[0], value);
    setText(node.parts[1], note);
    setAttr(node.parts[1], 'title', note);
    setAttr(node, 'class', `tile ${tone}`);
  });
}

const TILES = ['Routes running', 'Messages a second', 'In flight', 'Lag in Kafka', 'Slowest p99', 'Dead letters'];
const UNTOLD = TILES.map((word) => [word, '–', 'not known yet', '']);

function ofRoutes({ routes, about, letters }) {
  const running = routes.filter((it) => it.state === 'running').length;
  const failed = routes.filter((it) => it.state === 'failed').length;
  const slow = routes.reduce((worst, it) => ((it.delay_s?.[1] ?? -1) > (worst?.delay_s?.[1] ?? -1) ? it : worst), null);
  const still = routes.some((it) => it.rate === null) ? 'not known yet' : 'nothing moves';
  const [rates, flight, dead] = [(it) => it.rate, (it) => it.in_flight, (it) => it.ended.dead_lettered].map((read) => sum(routes, read));
  const written = rates.total === null ? '' : `${bytes(sum(routes, (it) => it.bytes_rate).total)}/s`;
  const spools = new Set(about.filter((it) => it.spool).map((it) => it.name));
  const onDisk = sum(routes, (it) => it.spooled ?? (spools.has(it.name) ? null : 0));
  const hidden = sum(routes, (it) => (spools.has(it.name) ? onItsWay(it) : it.in_flight)).rest;
  const tiles = [
    [`${count(running)} / ${count(routes.length)}`, failed ? `${counted(failed, 'route')} failed` : 'none failed', failed ? 'bad' : ''],
    [rate(rates.total), noted(written, unknown(rates.rest, 'route')), ''],
    [count(flight.total), noted(diskWord(onDisk), unknown(hidden, 'route')), ''],
    [...lagWords(routes, about), ''],
    [seconds(slow?.delay_s?.[1]), slow?.delay_s ? slow.name : still, ''],
    [count(dead.total), noted('since the workers started', unknown(dead.rest, 'route'), keptWords(letters)), dead.total ? 'warn' : ''],
  ];
  return tiles.map((it, at) => [TILES[at], ...it]);
}

const noted = (...notes) => notes.filter(Boolean).join('; ');
const unknown = (rest, thing) => (rest ? `${counted(rest, thing)} not known` : '');

function diskWord({ total, rest }) {
  if (total) return `${count(total)} wait on disk`;
  return rest ? '' : 'nothing waits on disk';
}

// How many letters their topics keep: one that is not there keeps none.
function keptWords(letters) {
  const { total, rest } = sum(letters.filter((it) => it.there !== false), (it) => it.held);
  return noted(total === null ? '' : `${count(total)} kept`, unknown(rest, 'topic'));
}

// A lag that is not known, while Kafka is away for instance, is not none.
function lagWords(routes, about) {
  const names = reading(about);
  const lagging = routes.filter((it) => names.has(it.name));
  const { total, rest } = sum(lagging, (it) => it.lag);
  if (total === null) return ['–', lagging.length ? 'not known' : 'no route reads Kafka'];
  const most = lagging.reduce((worst, it) => (it.lag > worst.lag ? it : worst));
  return [count(total), noted(most.lag ? `most: ${most.name}` : 'records behind', unknown(rest, 'route'))];
}

function kafkaWord(broker) {
  if (!broker) return '–';
  return broker.problem ? 'away' : counted(broker.brokers.length, 'broker');
}
