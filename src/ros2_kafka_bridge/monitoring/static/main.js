// The page: takes the view as it changes, and gives each part what it shows.

import { Detail } from './detail.js';
import { $, setAttr, setChip, setText, show } from './shared/dom.js';
import { Graph } from './graph.js';
import { Letters } from './letters.js';
import { Lock } from './orders.js';
import { drawErrors, drawSystem } from './panels.js';
import { Routes } from './routes.js';
import { get, listen } from './shared/server.js';
import { History } from './spark.js';
import { count, reading, span } from './words.js';

const VIEWS = ['routes', 'graph', 'letters', 'errors', 'system'];

const view = { bridge: null, about: [], routes: [], troubles: [], workers: [], broker: null, letters: [], replay: null };
const history = new History();
const lock = new Lock(() => {
  lookAgain(); // those with the token have places of their own
  draw();
});
const mayChange = () => lock.mayChange(view.bridge);
const detail = new Detail(history, (route) => lock.pause(route));
const routes = new Routes(history, (name) => detail.open(name, view, mayChange()), (route) => lock.pause(route));
const letters = new Letters(lock);
const graph = new Graph();
let connected = false;
let letGo = ''; // why
let current = '';
let offsetS = 0; // of the server's clock from ours

$('reload').onclick = () => lock.reload();
$('again').onclick = () => lookAgain();

const lookAgain = listen((changed) => {
  [connected, letGo] = [true, ''];
  Object.assign(view, changed);
  if (changed.bridge) offsetS = changed.bridge.now_s - Date.now() / 1000;
  if (changed.routes) history.add(view.bridge.now_s, view.routes, reading(view.about));
  draw();
}, async () => {
  try {
    history.load(await get('api/history'));
  } catch { /* the lines begin with what comes */ }
}, (why) => {
  [connected, letGo] = [false, why];
  draw();
});

let scheduled = false;
function draw() {
  if (scheduled) return;
  scheduled = true;
  requestAnimationFrame(() => {
    scheduled = false;
    drawNow();
  });
}

function drawNow() {
  const nowS = Date.now() / 1000 + offsetS;
  drawTop(nowS);
  lock.draw(view.bridge);
  if (!view.bridge) return;
  const may = mayChange();
  if (current === 'routes') routes.draw(view, may);
  if (current === 'letters') letters.draw(view);
  if (current === 'errors') drawErrors(view.troubles, view.bridge.lifecycle !== null);
  if (current === 'system') drawSystem(view, nowS);
  detail.draw(view, may);
}

function drawTop(nowS) {
  const { bridge } = view;
  const [word, tone] = live(bridge);
  setChip($('live'), word, tone);
  document.body.classList.toggle('old', Boolean(bridge) && !isNew(bridge));
  if (bridge) {
    setText($('name'), bridge.name);
    document.title = `${word === 'Ready' ? '' : `${word} – `}${bridge.name} – ros2-kafka-bridge`;
    const up = bridge.started_s ? ` · up ${span(nowS - bridge.started_s)}` : '';
    setText($('about'), `ros2-kafka-bridge ${bridge.version}${up}`);
  }
  const problem = trouble(bridge);
  setText($('problem'), problem);
  show($('banner'), Boolean(problem));
  show($('again'), Boolean(letGo));
  const odd = view.routes.filter((it) => it.mismatched).length;
  const dead = view.routes.reduce((total, it) => total + it.ended.dead_lettered, 0);
  const away = view.workers.filter((it) => !it.pid).length + (view.broker?.problem ? 1 : 0);
  mark('routes', view.routes.length, false);
  mark('graph', odd, true);
  mark('letters', dead, false);
  mark('errors', view.troubles.length, false);
  mark('system', away, true);
}

function mark(name, number, bad) {
  const node = $(`n-${name}`);
  setText(node, number ? count(number) : '');
  setAttr(node, 'class', bad ? 'count bad' : 'count');
}

const isNew = (bridge) => connected && !bridge.old;

function live(bridge) {
  if (!bridge) return letGo ? ['Too many look', 'warn'] : ['Connecting', 'calm'];
  if (connected && bridge.lifecycle === null) return ['No report yet', 'warn'];
  if (!isNew(bridge)) return ['Old data', 'warn'];
  if (bridge.stopping) return ['Stopping', 'warn'];
  return bridge.ready ? ['Ready', 'good'] : ['Not ready', 'bad'];
}

function trouble(bridge) {
  if (letGo) return `${letGo} ${bridge ? 'What is shown is old; the' : 'The'} page looks again in half a minute.`;
  if (!connected) return bridge ? 'The server of this page does not answer. What is shown is old; the page goes on by itself once it answers.' : '';
  if (bridge.lifecycle === null) return 'The bridge has told nothing yet: what its routes do is not known.';
  if (bridge.old) return `The bridge has told nothing for ${span(bridge.report_age_s)}. What is shown is old.`;
  if (bridge.stopping) return 'The bridge drains to end.';
  return bridge.lifecycle === 'active' ? '' : `The bridge is ${bridge.lifecycle}: no route runs.`;
}

// Views

function turn() {
  const wanted = location.hash.slice(1);
  const next = VIEWS.includes(wanted) ? wanted : wanted === 'main' ? current || 'routes' : 'routes';
  if (next === current) return;
  current = next;
  for (const name of VIEWS) show($(`view-${name}`), name === current);
  for (const link of $('views').children) setAttr(link, 'aria-current', link.hash === `#${current}` ? 'page' : null);
  graph.show(current === 'graph');
  scrollTo(0, 0);
  drawNow();
}
addEventListener('hashchange', turn);
turn();

// Keys: 1 to 5 turn to a view, / finds a route, Escape empties what was looked for.
addEventListener('keydown', (event) => {
  const typing = /^(INPUT|SELECT|TEXTAREA)$/.test(event.target.tagName);
  if (event.key === 'Escape' && event.target === $('find')) {
    $('find').value = '';
    routes.again();
  }
  if (typing || event.ctrlKey || event.metaKey || event.altKey || document.querySelector('dialog[open]')) return;
  if (event.key === '/') {
    event.preventDefault();
    location.hash = '#routes';
    $('find').focus();
  } else if (VIEWS[event.key - 1]) {
    location.hash = `#${VIEWS[event.key - 1]}`;
  }
});
