// The page: takes the view as it changes, and gives each part what it shows.

import { Detail } from './detail.js';
import { $, h, keyed, setAttr, setText, show, toast } from './shared/dom.js';
import { drawKpis } from './kpis.js';
import { FloorMap } from './map.js';
import { setUpOrderForm } from './order_form.js';
import { drawFailures, drawOrders, drawRobots } from './panels.js';
import { get, listen, post } from './shared/server.js';
import { SHARES, clock, codeWord, plural, span } from './words.js';

const OLD_S = 3;
const SECTIONS_EVERY_MS = 250; // tables need not follow each step

const view = {
  floor: { step: -1, robots: [], blocked: [], placed: [], halted: '' },
  plans: { plans: {} },
  orders: { open: [], openCount: 0, ended: [] },
  failures: [],
  kpis: {},
  validator: null,
  health: null,
};
let connected = false;
let letGo = ''; // why
let selected = null;
let shownOrders = 'open';
let clockOffsetS = 0; // of the server's clock from ours
let rateTouched = false;

const { site, failures } = await getSite();
site.chargers ??= [];
site.largeTypes = largeTypes(site);
setText($('site'), site.name);
document.title = `${site.name} – warehouse`;
const map = new FloorMap($('map'), site);
const detail = new Detail(site, failures, order, () => select(null));

async function getSite() {
  for (;;) {
    try {
      return await get('api/site');
    } catch { /* the server is away: asked again */ }
    await new Promise((resolve) => setTimeout(resolve, 1000));
  }
}

// The second and further types of robots are drawn square.
function largeTypes({ robots }) {
  const types = [...new Set(Object.values(robots).map((place) => place.robotType))].sort();
  return new Set(types.slice(1));
}

const nowS = () => Date.now() / 1000 + clockOffsetS;

// What comes in

listen((changed) => {
  [connected, letGo] = [true, ''];
  Object.assign(view, changed);
  if (changed.health) clockOffsetS = changed.health.nowS - Date.now() / 1000;
  if (changed.floor) map.takeFloor(changed.floor);
  if (changed.plans) map.takePlans(changed.plans.plans);
  schedule();
}, () => {}, (why) => {
  [connected, letGo] = [false, why];
  schedule();
});

let scheduled = false;
function schedule() {
  if (scheduled) return;
  scheduled = true;
  setTimeout(() => {
    scheduled = false;
    draw();
  }, SECTIONS_EVERY_MS);
}

function draw() {
  keepFocus(() => {
    drawLive();
    drawBanners();
  });
  drawRate();
  drawKpis(view.kpis, view.validator);
  drawOrders(view.orders, shownOrders, nowS());
  drawRobots(view.floor.robots, selected?.robot, (robot) => select({ robot }));
  drawFailures(view.failures, (robot) => select({ robot }));
  drawDetail();
}

// A button that was pressed and is gone leaves its place to the one that undoes it.
function keepFocus(change) {
  const before = document.activeElement;
  change();
  if (!before || before === document.body) return;
  if (before.isConnected && !before.hidden) return;
  const next = [$('pause'), $('resume')].find((button) => !button.hidden);
  next.focus();
}

function drawDetail() {
  const tasks = new Map();
  for (const order of view.orders.open) {
    for (const line of order.lines ?? []) tasks.set(`${order.id}/${line.id}`, { ...line, station: order.station });
  }
  detail.draw(selected, {
    robots: view.floor.robots,
    blocked: view.floor.blocked ?? [],
    placed: view.floor.placed ?? [],
    plans: view.plans.plans,
    nowS: nowS(),
    tasks,
  });
}

// Whether what is shown is new

function trouble() {
  if (letGo) return `${letGo} What is shown is old; the page looks again in half a minute.`;
  if (!connected) return 'The page’s server does not answer. What is shown is old; the page goes on by itself once it answers.';
  if (!view.health) return '';
  if (view.health.kafkaAway) return `Kafka does not answer (${view.health.kafkaAway}). What is shown is old; the page goes on by itself once Kafka answers.`;
  const age = view.health.ages['warehouse.robots'];
  if (age === undefined) return 'Kafka answers. No robot has been heard of yet.';
  const old = Math.max(OLD_S, 6 * (site.stepS ?? 0.5));
  if (age > old) return `No news from the robots for ${span(age)}: the bridge or the robots are away. What is shown is old.`;
  return '';
}

function drawLive() {
  const problem = trouble();
  const halted = view.floor.halted;
  const [state, word] = problem ? ['old', 'Old data'] : halted ? ['halted', 'Standing'] : view.health ? ['yes', 'Live'] : ['wait', 'Connecting'];
  setAttr($('state'), 'data-live', state);
  setText($('live'), word);
  setText($('step'), view.floor.step < 0 ? '' : `step ${view.floor.step.toLocaleString('en')}`);
  document.body.classList.toggle('old', Boolean(problem));
  show($('pause'), !halted);
  show($('resume'), Boolean(halted));
}

// Orders that nobody takes: said only while Kafka itself answers.
function standstill() {
  const still = view.health?.standstill;
  if (!still || !connected || view.health.kafkaAway) return '';
  return `${plural(still.count, 'order')} ${still.count === 1 ? 'has' : 'have'} had no answer since ${clock(still.sinceS)}: the intake of orders stands still. Look into the log of the bridge (route “orders”) and that of Orders.`;
}

const ACKNOWLEDGE = { id: 'acknowledge', word: 'Acknowledge', commands: ['acknowledge'] };
// The Monitor lets nobody drive on before the violation was acknowledged.
const GO_ON = { id: 'acknowledge-resume', word: 'Acknowledge and resume', commands: ['acknowledge', 'resume'] };
const RESUME = { id: 'banner-resume', word: 'Resume', commands: ['resume'] };

function stopBanner() {
  const last = view.validator?.unseen?.at(-1);
  const halted = view.floor.halted;
  if (last) {
    const text = `A rule of the floor was broken at step ${last.step}: ${last.description}.${halted ? ' All robots stand.' : ''}`;
    return { id: `violation ${Boolean(halted)}`, tone: 'bad', text, actions: halted ? [ACKNOWLEDGE, GO_ON] : [ACKNOWLEDGE] };
  }
  return halted ? { id: 'halted', tone: 'bad', text: `All robots stand: ${halted}`, actions: [RESUME] } : null;
}

function drawBanners() {
  const [problem, still, stop] = [trouble(), standstill(), stopBanner()];
  const banners = [
    ...(stop ? [stop] : []),
    ...(problem ? [{ id: 'old', tone: 'warn', text: problem }] : []),
    ...(still ? [{ id: 'intake', tone: 'warn', text: still }] : []),
  ];
  keyed($('banners'), banners, (banner) => banner.id, makeBanner, (node, banner) => setText(node.firstChild, banner.text));
}

function makeBanner({ tone, actions = [] }) {
  const press = async (commands) => {
    for (const command of commands) await order({ command });
  };
  const buttons = actions.map(({ id, word, commands }) => h('button', { type: 'button', id, onclick: () => press(commands) }, word));
  return h('div', { class: `banner ${tone}` }, h('p'), h('div', { class: 'actions' }, ...buttons));
}

function drawRate() {
  const input = $('per-minute');
  const rate = view.health?.rate ?? 0;
  setAttr($('rate'), 'data-on', rate > 0);
  if (!rateTouched && document.activeElement !== input && input.value !== String(rate)) input.value = rate;
}

// What a person does

async function order(command) {
  try {
    await post('api/commands', command);
    const of = command.robot ?? (command.cell ? `cell ${command.cell.join(', ')}` : 'all robots');
    const words = { failRobot: `Failure sent: ${codeWord(command.failure ?? '').toLowerCase()}`, blockCell: 'Block sent', unblockCell: 'Clearing sent' };
    toast(`${words[command.command] ?? `${command.command.replace('Robot', '').replace(/^./, (first) => first.toUpperCase())} sent`}, ${of}.`);
  } catch (error) {
    toast(error.message, true);
  }
}

function select(next) {
  selected = next;
  // The card lies on the other half of the map than what it speaks of.
  const at = map.robots.get(next?.robot)?.x ?? next?.cell?.[0] ?? 0;
  $('detail').classList.toggle('left', at > map.width / 2);
  map.set({ selected });
  draw();
}

function act(cell) {
  if (!cell) return;
  if ($('block-mode').checked) {
    toggleBlock(cell);
    return;
  }
  const robot = map.robotAt(cell);
  select(robot ? { robot } : { cell });
}

function toggleBlock(cell) {
  if (map.isWall(cell)) {
    toast('A shelf or a wall cannot be blocked.');
    return;
  }
  const same = ([x, y]) => x === cell[0] && y === cell[1];
  const there = (view.floor.blocked ?? []).some((entry) => same(entry.cell)) || (view.floor.placed ?? []).some(same);
  order({ command: there ? 'unblockCell' : 'blockCell', cell });
}

function hover(cell) {
  map.set({ hover: cell });
  const tip = $('tip');
  show(tip, Boolean(cell));
  if (!cell) return;
  const robot = map.robotAt(cell);
  const row = robot && view.floor.robots.find((each) => each.id === robot);
  const named = Object.entries(site.stations).find(([, [x, y]]) => x === cell[0] && y === cell[1])?.[0];
  const stock = Object.values(site.products).filter((product) => product.cells.some(([x, y]) => x === cell[0] && y === cell[1])).map((product) => product.name);
  setText(tip, row ? `${row.id}, ${row.status}, ${Math.round(row.battery)} %` : named ?? (stock.length ? stock.join(', ') : `${cell[0]}, ${cell[1]}`));
}

const canvas = $('map');
canvas.addEventListener('pointermove', (event) => hover(map.cellAt(event.offsetX, event.offsetY)));
canvas.addEventListener('pointerleave', () => hover(null));
canvas.addEventListener('click', (event) => act(map.cellAt(event.offsetX, event.offsetY)));
canvas.addEventListener('blur', () => hover(null));
canvas.addEventListener('keydown', (event) => {
  const moves = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
  const cell = map.hover ?? [Math.floor(map.width / 2), Math.floor(map.height / 2)];
  if (moves[event.key]) {
    const [dx, dy] = moves[event.key];
    hover([Math.min(map.width - 1, Math.max(0, cell[0] + dx)), Math.min(map.height - 1, Math.max(0, cell[1] + dy))]);
  } else if (event.key === 'Enter' || event.key === ' ') act(cell);
  else if (event.key === 'b' || event.key === 'B') toggleBlock(cell);
  else return;
  event.preventDefault();
});

document.addEventListener('keydown', (event) => {
  if (event.key === 'Escape' && !$('order-dialog').open) select(null);
});
$('show-paths').addEventListener('change', (event) => map.set({ showPaths: event.target.checked }));
$('show-names').addEventListener('change', (event) => map.set({ showNames: event.target.checked }));
$('block-mode').addEventListener('change', (event) => $('stage').classList.toggle('blocking', event.target.checked));
$('pause').addEventListener('click', () => order({ command: 'pause' }));
$('resume').addEventListener('click', () => order({ command: 'resume' }));
for (const kind of ['open', 'ended']) {
  $(`orders-${kind}`).addEventListener('click', () => {
    shownOrders = kind;
    setAttr($('orders-open'), 'aria-pressed', kind === 'open');
    setAttr($('orders-ended'), 'aria-pressed', kind === 'ended');
    draw();
  });
}
$('per-minute').addEventListener('input', () => { rateTouched = true; });
$('rate').addEventListener('submit', async (event) => {
  event.preventDefault();
  try {
    const { perMinute } = await post('api/rate', { perMinute: Number($('per-minute').value) });
    toast(perMinute ? `Random orders: ${perMinute} a minute.` : 'No more random orders.');
    rateTouched = false;
  } catch (error) {
    toast(error.message, true);
  }
});

$('legend').append(...Object.entries(SHARES).map(([name, word]) => h('li', {}, h('i', { class: `share ${name}` }), word)));
setUpOrderForm(site);
setInterval(schedule, 1000);
draw();

// For tests and the curious.
window.warehouse = { view, map };
