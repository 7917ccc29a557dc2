// Errors and the system: the bridge, Kafka, the workers.

import { $, drawn, facts, h } from './shared/dom.js';
import { card } from './detail.js';
import { bytes, clock, count, counted, seconds, span } from './words.js';

export function drawErrors(troubles, isTold) {
  const none = isTold ? 'No route has met an error since its process was started.' : 'Not known yet.';
  drawn($('errors'), [troubles, none], () => (troubles.length ? troubles.map(card) : [h('li', { class: 'empty' }, none)]));
}

export function drawSystem({ bridge, broker, workers }, nowS) {
  const reload = bridge.reload;
  const noReload = bridge.lifecycle === null ? null : 'none';
  const up = bridge.started_s ? `${span(nowS - bridge.started_s)}, since ${clock(bridge.started_s)}` : '';
  drawn($('bridge'), [bridge.file, bridge.lifecycle, bridge.ready, bridge.live, bridge.problems, reload, up], () => facts([
    ['version', bridge.version], ['file', bridge.file], ['runs', up],
    ['lifecycle', bridge.stopping ? `${bridge.lifecycle}, stopping` : bridge.lifecycle],
    ['lives', bridge.live ? 'yes' : 'no'],
    ['ready', bridge.ready ? 'yes' : h('ul', {}, ...bridge.problems.map((it) => h('li', {}, it)))],
    ['last reload', reload ? `${clock(reload.time_s)}: ${reload.done ? 'done' : 'refused'}: ${reload.text}` : noReload],
  ]));
  drawn($('workers'), workers, () => [
    h('thead', {}, h('tr', {}, ...['Worker', 'Process', 'Starts', 'Memory', 'Routes'].map((it) => h('th', { scope: 'col' }, it)))),
    h('tbody', {}, ...workers.map(worker)),
  ]);
  drawn($('broker-state'), broker?.problem ?? null, () => h('span', { class: `chip ${broker?.problem ? 'bad' : broker ? 'good' : 'calm'}` },
    broker?.problem ? 'away' : broker ? 'answers' : 'not asked yet'));
  drawn($('broker'), broker, () => (broker ? kafka(broker) : h('p', { class: 'empty' }, 'Not asked yet.')));
}

function worker(it) {
  return h('tr', {}, h('th', { scope: 'row' }, count(it.number)),
    h('td', { 'data-word': 'process' }, it.pid ? String(it.pid) : h('span', { class: 'chip bad' }, 'away'),
      it.problem ? h('span', { class: 'sub' }, it.problem) : null),
    h('td', { 'data-word': 'starts' }, count(it.starts)),
    h('td', { 'data-word': 'memory' }, bytes(it.memory_bytes)),
    h('td', { class: 'list' }, it.routes.length > 12 ? counted(it.routes.length, 'route') : it.routes.join(', ')));
}

function kafka(broker) {
  const then = broker.problem ? ' then' : '';
  const odd = (broker.topics ?? []).filter((it) => it.problem || it.leaderless || it.under_replicated);
  return [
    broker.problem ? h('p', { class: 'empty bad' }, broker.problem) : null,
    then && broker.cluster_id ? h('p', { class: 'before' }, `Kafka last answered at ${clock(broker.seen_s)}. What it told then:`) : null,
    broker.cluster_id ? h('dl', { class: 'facts' }, ...facts([
      ['cluster', broker.cluster_id],
      ['asked', then ? '' : `at ${clock(broker.seen_s)}, answered in ${seconds(broker.round_trip_s)}`],
      ['brokers', h('ul', {}, ...broker.brokers.map((it) => h('li', {}, `${it.address} (${it.id}${it.id === broker.controller ? ', controller' : ''})`)))],
      ['topics of routes', `${count(broker.topics.length)}, ${odd.length ? `${count(odd.length)} with trouble` : 'all well'}${then}`],
    ])) : null,
    odd.length ? h('ul', { class: 'cards' }, ...odd.map((it) => h('li', { class: 'card' }, h('b', {}, it.name),
      h('p', { class: 'said' }, it.problem || [it.leaderless && `${counted(it.leaderless, 'partition')} without a leader`,
        it.under_replicated && `${counted(it.under_replicated, 'partition')} with a replica that is behind or away`].filter(Boolean).join(', '))))) : null,
  ];
}
