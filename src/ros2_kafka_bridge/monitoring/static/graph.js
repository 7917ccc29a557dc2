// The ROS graph: who is at each topic, with which QoS, and what does not match.

import { $, drawn, h, setText } from './shared/dom.js';
import { get } from './shared/server.js';
import { clock, counted } from './words.js';

const EVERY_MS = 3000;

export class Graph {
  constructor() {
    this.timer = null;
    this.graph = null;
    $('graph-all').onchange = () => this.draw();
  }

  show(visible) {
    clearTimeout(this.timer);
    this.timer = null;
    if (visible) this.look();
  }

  async look() {
    const timer = this.timer = setTimeout(() => this.look(), EVERY_MS);
    try {
      this.graph = await get('api/graph');
    } catch (error) {
      setText($('graph-about'), error.message);
      return;
    }
    if (this.timer === timer) this.draw();
  }

  draw() {
    const graph = this.graph;
    if (!graph) return;
    const seen = graph.seen_s ? `seen at ${clock(graph.seen_s)}` : 'looking …';
    setText($('graph-about'), [graph.domain, graph.middleware, seen, graph.hidden].filter(Boolean).join(' · '));
    const topics = graph.topics.filter((it) => it.routes.length || ($('graph-all').checked && !it.of_ros));
    drawn($('graph'), { topics, problem: graph.problem, seen: Boolean(graph.seen_s) }, () => {
      if (graph.problem) return h('p', { class: 'empty bad' }, graph.problem);
      if (!topics.length) return h('p', { class: 'empty' }, graph.seen_s ? 'Nobody is there.' : 'Looking …');
      const bad = (it) => it.matches.some((match) => match.problem);
      return h('ul', { class: 'topics' }, ...[...topics].sort((a, b) => bad(b) - bad(a)).map(topicNode));
    });
  }
}

function topicNode(topic) {
  const wrong = topic.matches.filter((it) => it.problem);
  const routes = topic.routes.map((it) => `${it.route} ${it.does}`).join(', ');
  return h('li', { class: wrong.length ? 'topic wrong' : 'topic' },
    h('div', { class: 'topic-head' }, h('h3', {}, topic.name), h('span', { class: 'note' }, topic.problem || topic.types.join(' and ') || 'nobody is there'),
      h('span', { class: 'note' }, routes)),
    h('ul', { class: 'wrongs' }, ...wrong.map((it) => h('li', {}, h('b', {}, it.node), ` and ${it.route}: ${it.problem}.`,
      // No full stop behind what is to be pasted.
      it.cure ? h('span', { class: 'todo' }, `${it.cure[0].toUpperCase()}${it.cure.slice(1)}${it.cure.endsWith('}') ? '' : '.'}`) : null))),
    h('div', { class: 'sides' }, side('publisher', topic.publishers, topic), side('subscriber', topic.subscribers, topic)));
}

function side(word, peers, topic) {
  const of = (peer) => topic.matches.filter((it) => it.node === peer.node);
  return h('div', {}, h('h4', {}, peers.length ? counted(peers.length, word) : topic.problem ? `${word}s not known` : `no ${word}`),
    h('ul', {}, ...peers.map((peer) => {
      const matches = peer.own ? [] : of(peer);
      const bad = matches.some((it) => it.problem);
      const unknown = matches.find((it) => it.unknown)?.unknown;
      const match = unknown ? ['calm', 'not known'] : ['good', 'matches'];
      const sign = peer.own ? ['own', 'this bridge'] : bad ? ['bad', 'does not match'] : matches.length ? match : null;
      const odd = topic.types.length > 1 ? `${peer.type} · ` : '';
      return h('li', { class: 'peer' }, h('span', { class: 'node' }, peer.node),
        sign ? h('span', { class: `chip ${sign[0] === 'own' ? 'busy' : sign[0]}` }, sign[1]) : null,
        h('span', { class: 'sub' }, odd + peer.qos.join(' · ')),
        unknown && !bad ? h('span', { class: 'sub' }, unknown) : null);
    })));
}
