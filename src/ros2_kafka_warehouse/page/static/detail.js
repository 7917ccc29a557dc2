// What is selected on the map, and what can be done with it.

import { $, drawn, facts, h, setText, show } from './shared/dom.js';
import { codeWord, plural, robotState, span, WALL } from './words.js';

// `order(command)` sends a command.
export class Detail {
  constructor(site, failures, order, close) {
    this.node = $('detail');
    this.site = site;
    this.failures = failures;
    this.order = order;
    this.close = close;
    this.shown = '';
  }

  draw(selected, state) {
    show(this.node, Boolean(selected));
    if (!selected) {
      this.shown = '';
      this.node.replaceChildren();
      return;
    }
    const name = selected.robot ?? selected.cell.join(',');
    if (this.shown !== name) {
      this.shown = name;
      this.build(selected);
    }
    if (selected.robot) this.drawRobot(selected.robot, state);
    else this.drawCell(selected.cell, state);
  }

  build(selected) {
    this.title = h('h3');
    this.facts = h('dl');
    this.actions = h('div', { class: 'actions' });
    const close = h('button', { type: 'button', class: 'close', 'aria-label': 'Close', onclick: this.close }, '×');
    this.node.replaceChildren(h('div', { class: 'detail-head' }, this.title, close), this.facts, this.actions);
    if (selected.robot) this.buildRobot(selected.robot);
    else this.buildCell(selected.cell);
  }

  buildRobot(robot) {
    const code = h('select', { 'aria-label': 'Failure', id: 'fail-code' },
      ...Object.entries(this.failures).map(([name, words]) => h('option', { value: name }, words)));
    const button = (id, word, command) => h('button', { type: 'button', id, onclick: () => this.order({ command, robot }) }, word);
    this.actions.append(
      h('div', { class: 'pair' }, code,
        h('button', { type: 'button', id: 'fail', class: 'danger', onclick: () => this.order({ command: 'failRobot', robot, failure: code.value }) }, 'Fail')),
      button('repair', 'Repair', 'repairRobot'), button('rejoin', 'Rejoin', 'rejoinRobot'), button('remove', 'Remove', 'removeRobot'));
  }

  buildCell(cell) {
    const button = (id, word, command) => h('button', { type: 'button', id, onclick: () => this.order(command) }, word);
    this.pallet = button('block', 'Put a pallet here', { command: 'blockCell', cell });
    this.known = button('block-known', 'Close for robots', { command: 'blockCell', cell, known: true });
    this.free = button('unblock', 'Clear', { command: 'unblockCell', cell });
    this.actions.append(this.pallet, this.known, this.free);
  }

  tell(pairs) {
    drawn(this.facts, pairs, facts);
  }

  drawRobot(id, { robots, plans, nowS, tasks }) {
    setText(this.title, id);
    const row = robots.find((robot) => robot.id === id);
    if (!row) {
      this.tell([['State', 'not heard of']]);
      return;
    }
    const plan = plans[id];
    const task = tasks.get(row.task);
    this.tell([
      ['Type', row.type],
      ['State', robotState(row.status).word + (row.paused ? ', paused' : '')],
      ['Battery', `${row.battery} %${row.charging ? ', charging' : ''}`],
      ['Cell', row.cell.join(', ')],
      ['Task', task ? `${task.quantity} × ${task.product} to ${task.station}` : row.task || 'none'],
      ['Load', row.load ? `${row.loadKg ?? 0} kg` : 'none'],
      ['Next', row.queued ? plural(row.queued, 'more task') : ''],
      ['On its way to', plan?.path?.length ? `${plan.path.at(-1).join(', ')}${plan.purpose ? ` (${plan.purpose})` : ''}` : ''],
      ['Failure', row.failure ? codeWord(row.failure) : ''],
      ['Since', row.failure && row.sinceS ? span(nowS - row.sinceS) : ''],
      ['Answer', row.answer ?? ''],
      ['Reports', (row.errors ?? []).join('; ')],
      ['In service', row.commissioned === false ? 'not until it rejoins' : ''],
    ]);
  }

  drawCell(cell, { blocked, placed, nowS }) {
    const [x, y] = cell;
    const same = ([a, b]) => a === x && b === y;
    setText(this.title, `Cell ${x}, ${y}`);
    const block = blocked.find((entry) => same(entry.cell));
    const stands = placed.some(same);
    const kind = this.site.rows[y][x];
    const wall = kind === WALL;
    const named = (places) => Object.entries(places).find(([, place]) => same(place))?.[0];
    const products = Object.values(this.site.products).filter((product) => product.cells.some(same));
    this.tell([
      ['Is', wall ? 'a shelf or a wall' : named(this.site.stations) ? `station ${named(this.site.stations)}` : (this.site.chargers ?? []).some(same) ? 'a charger' : kind === 'e' ? 'a stock cell' : kind === 'r' ? 'a robot’s home' : 'an aisle'],
      ['Stock', products.map((product) => `${product.name} (${product.weightKg ?? 1} kg)`).join(', ')],
      ['Blocked', block ? `${block.reason || 'yes'}${block.sinceS ? `, for ${span(nowS - block.sinceS)}` : ''}` : ''],
      ['Pallet', stands && !block ? 'put here; no robot has found it yet' : ''],
    ]);
    show(this.pallet, !wall && !stands && !block);
    show(this.known, !wall && !stands && !block);
    show(this.free, Boolean(block) || stands);
  }
}
