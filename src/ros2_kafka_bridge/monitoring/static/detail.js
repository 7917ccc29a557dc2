// One route in full, in a drawer at the side.

import { $, drawn, facts, h, setChip, setText, show } from './shared/dom.js';
import { drawSpark, spark } from './spark.js';
import { OUTCOMES, TONES, arrow, bytes, clock, count, counted, onItsWay, rate, readsKafka, seconds } from './words.js';

export class Detail {
  constructor(history, pause) {
    this.history = history;
    this.name = null;
    this.node = $('drawer');
    this.node.onclose = () => { this.name = null; };
    this.node.onclick = (event) => { if (event.target === this.node) this.node.close(); };
    const p = this.parts = {
      title: h('h2', { id: 'drawer-title' }),
      chip: h('span', { class: 'chip' }),
      ends: h('p', { class: 'note' }),
      reason: h('p'),
      advice: h('p', { class: 'note' }),
      rate: spark(560, 90), rateTimes: times(), rateWord: h('p', { class: 'note' }),
      held: spark(560, 90), heldTimes: times(), heldWord: h('p', { class: 'note' }), heldTitle: h('h3'),
      facts: h('div', { class: 'groups' }),
      errors: h('ol', { class: 'cards' }),
      button: h('button', { type: 'button', class: 'main', onclick: () => pause(this.route) }),
      hint: h('p', { class: 'note' }),
    };
    this.node.append(
      h('div', { class: 'drawer-head' }, p.title, p.chip,
        h('button', { type: 'button', class: 'close', 'aria-label': 'Close', onclick: () => this.node.close() }, '×')),
      p.ends, h('div', { class: 'why' }, p.reason, p.advice),
      h('div', { class: 'actions' }, p.button, p.hint),
      h('h3', {}, 'Messages a second'), h('div', { class: 'chart' }, p.rate, p.rateTimes, p.rateWord),
      p.heldTitle, h('div', { class: 'chart' }, p.held, p.heldTimes, p.heldWord),
      p.facts, h('h3', {}, 'Last errors'), p.errors,
    );
  }

  open(name, view, mayChange) {
    this.name = name;
    this.draw(view, mayChange);
    if (this.name && !this.node.open) this.node.showModal();
  }

  draw(view, mayChange) {
    if (this.name === null) return;
    const route = this.route = view.routes.find((it) => it.name === this.name);
    if (!route) {
      this.node.close();
      return;
    }
    const about = view.about.find((it) => it.name === this.name);
    const p = this.parts;
    setText(p.title, route.name);
    setChip(p.chip, route.state, TONES[route.state]);
    setText(p.ends, about ? `${arrow(about)} · ${about.type || 'the type of its publishers'} as ${about.format}` : '');
    setText(p.reason, route.reason);
    setText(p.advice, route.advice);
    show(p.reason.parentNode, Boolean(route.reason || route.advice));
    setText(p.button, route.paused ? 'Resume' : 'Pause');
    show(p.button, mayChange);
    setText(p.hint, mayChange
      ? (readsKafka(about) ? 'While paused, records wait in Kafka.' : 'While paused, DDS holds reliable publishers back.')
      : view.bridge?.may_change ? 'Unlock the page to pause or resume it.' : 'The page is read-only: monitoring.token is not set.');
    const rates = this.history.rates(this.name);
    drawSpark(p.rate, rates, this.history.span);
    setText(p.rateWord, `now ${rate(route.rate)}, most ${rate(rates.most)} in the last ${this.history.span / 60} minutes`);
    const held = this.history.held(this.name);
    drawSpark(p.held, held, this.history.span);
    const ends = this.history.ends.map((at) => clock(at).slice(0, -3));
    for (const axis of [p.rateTimes, p.heldTimes]) ends.forEach((it, at) => setText(axis.children[at], it));
    const lags = readsKafka(about);
    setText(p.heldTitle, lags ? 'Lag in records' : 'In flight and on disk');
    setText(p.heldWord, `now ${count(lags ? route.lag : onItsWay(route))}, most ${count(held.most)}`);
    drawn(p.facts, [route, about], () => this.groups(route, about));
    drawn(p.errors, view.troubles.filter((it) => it.route === this.name), (found) => (found.length
      ? found.map(card) : [h('li', { class: 'empty' }, 'None.')]));
  }

  groups(route, about) {
    const both = (pair) => (pair ? `${seconds(pair[0])} / ${seconds(pair[1])}` : '–');
    const ended = Object.entries(OUTCOMES).filter(([key]) => key === 'confirmed' || key === 'dead_lettered' || route.ended[key]);
    const produces = about && !readsKafka(about);
    const groups = {
      'Since the start of its worker': [
        ['taken', count(route.taken)],
        ...ended.map(([key, word]) => [word, count(route.ended[key])]),
        ['in flight', count(route.in_flight)],
        ['on disk', about?.spool || route.spooled ? onDisk(route) : null],
        ['published again', route.repeated ? count(route.repeated) : null],
        ['sent though their number is there', route.unproved ? count(route.unproved) : null],
        ['lost before the bridge', route.lost_upstream ? count(route.lost_upstream) : null],
        ['bytes confirmed', bytes(route.bytes_confirmed)],
        ['bytes published', route.bytes_published || route.ended.published ? bytes(route.bytes_published) : null],
      ],
      'Times, p50 / p99 of the last minute': [
        [produces ? 'until Kafka has it' : 'until published', both(route.delay_s)],
        ['end to end', both(route.end_to_end_s)],
        ['until readers are seen to have it', produces ? null : both(route.in_bridge_s)],
        ['producer', produces ? both(route.produce_s) : null],
        ['broker round trip', route.broker_round_trip_s ? both(route.broker_round_trip_s) : null],
        ['held back by the sink', route.waited === null ? '–' : `${Math.round(route.waited * 100)} % of the time`],
      ],
      Connections: [
        ['sink holds', `${count(route.queued)}${route.queue_limit ? ` of ${count(route.queue_limit)}` : ''}`],
        ['DDS endpoints that match', count(route.matched)],
        ['that do not match', count(route.mismatched)],
        ['memory, at most', route.memory_limit === null ? null : bytes(route.memory_limit)],
        ['rebalances', readsKafka(about) ? count(route.rebalances) : null],
        ['worker', route.worker ? count(route.worker) : null],
        ['numbers are', route.age_s === null ? 'not told yet' : `${seconds(Math.max(0.1, route.age_s))} old`],
      ],
      Settings: about ? [
        ['on error', about.on_error], ['when full', about.when_full], ['max in flight', count(about.max_in_flight)],
        ['dead letters go to', about.dead_letter_topic], ['consumer group', about.group],
      ] : [],
    };
    return Object.entries(groups).map(([title, pairs]) => h('section', {}, h('h3', {}, title),
      h('dl', { class: 'facts' }, ...facts(pairs))));
  }
}

const onDisk = (route) => (route.spooled === null ? '–' : `${count(route.spooled)} (${bytes(route.spool_bytes)})`);

// Below a chart: from when to when.
const times = () => h('p', { class: 'times' }, h('time'), h('time'));

// An error: what has happened, and what to do: after the last semicolon, where the text says it.
export function card(trouble) {
  const at = trouble.text.lastIndexOf('; ');
  const [what, todo] = at < 0 ? [trouble.text, trouble.advice] : [trouble.text.slice(0, at), trouble.text.slice(at + 2)];
  return h('li', { class: 'card' },
    h('p', { class: 'when' }, h('time', {}, clock(trouble.time_s)), h('span', { class: 'chip bad' }, trouble.error),
      h('b', {}, trouble.route), trouble.times > 1 ? h('span', { class: 'note' }, counted(trouble.times, 'time')) : null),
    h('p', { class: 'said' }, what),
    todo ? h('p', { class: 'todo' }, todo[0].toUpperCase() + todo.slice(1)) : null);
}
