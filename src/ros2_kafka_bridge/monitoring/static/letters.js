// Dead letters: how many, which, what is in one, and sending them again.

import { $, drawn, facts, h, keyed, setAttr, setText, show, toast } from './shared/dom.js';
import { get, post, token } from './shared/server.js';
import { bytes, clock, count, counted } from './words.js';

export class Letters {
  constructor(lock) {
    this.lock = lock;
    this.topic = null;
    this.list = null;
    this.chosen = new Set();
    this.asked = 0;
    this.host = $('letters');
    this.host.append(
      h('div', { class: 'panel' },
        h('div', { class: 'head' }, h('h2', {}, 'Dead-letter topics'), h('p', { class: 'note' }, 'offsets kept in Kafka; a mark for each replay is one, too')),
        this.none = h('p', { class: 'empty' }, ''),
        this.topics = h('ul', { class: 'boxes', hidden: true })),
      this.panel = h('div', { class: 'panel', hidden: true }),
      this.job = h('div', { class: 'panel', hidden: true }),
    );
  }

  draw({ letters, replay, bridge, broker }) {
    this.may = this.lock.mayChange(bridge);
    const away = broker?.problem ? `Nothing of these topics is known now: ${broker.problem}` : '';
    setText(this.none, broker ? away : 'Kafka has not been asked yet.');
    show(this.none, !broker || Boolean(away));
    show(this.topics, Boolean(letters.length));
    keyed(this.topics, letters, (it) => it.topic, (it) => this.topicBox(it.topic), (node, it) => this.drawTopic(node, it, away));
    if (this.wasMay !== this.may) {
      this.wasMay = this.may;
      this.drawList();
    }
    this.drawJob(replay);
  }

  topicBox(topic) {
    return h('li', {}, h('button', { type: 'button', onclick: () => this.open(topic) },
      h('b'), h('span', {}, topic), h('span', { class: 'sub' }), h('span', { class: 'sub' })));
  }

  drawTopic(node, it, away) {
    const button = node.firstElementChild;
    setAttr(button, 'aria-pressed', String(it.topic === this.topic));
    // One that cannot be seen now may be there: who opens it is told why it is not to be read.
    const missing = it.there === false;
    if (button.disabled !== missing) button.disabled = missing;
    setText(button.children[0], missing ? 'none' : count(it.held));
    setText(button.children[2], it.routes.join(', '));
    setText(button.children[3], it.there === null && !away ? `not to be seen: ${it.problem}` : '');
  }

  async open(topic) {
    if (topic !== this.topic) [this.topic, this.list] = [topic, null];
    this.chosen.clear();
    this.drawList();
    const asked = this.asked += 1;
    const read = () => this.lock.act(() => get(`api/dead-letters/${encodeURIComponent(topic)}`));
    const shown = token();
    const list = await read() ?? (shown && !token() ? await read() : null); // the list needs none
    if (list && asked === this.asked) this.list = list;
    this.drawList();
  }

  drawList() {
    const list = this.list;
    show(this.panel, this.topic !== null);
    if (this.topic === null) return;
    const hint = h('p', { class: 'note' }, this.may ? '' : 'Unlock the page to replay letters.');
    this.button = h('button', { type: 'button', onclick: () => this.begin([...this.chosen]) });
    const all = h('button', { type: 'button', onclick: () => this.begin(null) }, 'Replay all…');
    show(this.button, this.may);
    show(all, this.may && Boolean(list?.letters.length));
    const head = h('div', { class: 'head' }, h('h2', {}, this.topic),
      h('p', { class: 'note' }, list ? `${counted(list.seen, 'letter')} among the newest offsets, ${count(list.replayed)} replayed` : 'Reading …'),
      hint, this.button, all, h('button', { type: 'button', onclick: () => this.open(this.topic) }, 'Read again'));
    const rows = list?.letters ?? [];
    const hidden = list?.unseen ?? [];
    const none = hidden.length ? 'No letters are seen.' : 'There are no letters.';
    const body = rows.length ? this.table(rows) : h('p', { class: 'empty' }, list ? none : 'Reading …');
    this.panel.replaceChildren(head, ...hidden.map((it) => h('p', { class: 'empty' }, it)), body);
    this.drawButton();
  }

  drawButton() {
    setText(this.button, this.chosen.size ? `Replay ${count(this.chosen.size)}…` : 'Choose letters to replay');
    this.button.disabled = !this.chosen.size;
  }

  table(rows) {
    const boxes = [];
    const choose = (row, box) => {
      if (box.checked) this.chosen.add(row.place);
      else this.chosen.delete(row.place);
      this.drawButton();
    };
    const every = h('input', { type: 'checkbox', 'aria-label': 'All that are shown and not replayed', onchange: () => {
      boxes.forEach(([row, box]) => { if (!row.replayed_to) { box.checked = every.checked; choose(row, box); } });
    } });
    const line = (row) => {
      const box = h('input', { type: 'checkbox', checked: this.chosen.has(row.place), disabled: !row.ours, 'aria-label': `Choose ${row.place}`, onchange: () => choose(row, box) });
      boxes.push([row, box]);
      return h('tr', {},
        this.may ? h('td', { class: 'choose' }, box) : null,
        h('th', { scope: 'row' }, h('button', { type: 'button', class: 'link', onclick: () => this.look(row) }, `[${row.partition}]@${row.offset}`),
          h('span', { class: 'sub' }, clock(row.time_ms / 1000))),
        h('td', { 'data-word': 'route' }, row.route || '–', h('span', { class: 'sub' }, row.source)),
        h('td', { class: 'reason' }, row.reason),
        h('td', { 'data-word': 'size' }, bytes(row.bytes)),
        h('td', { 'data-word': 'replayed' }, row.replayed_to ? h('span', { class: 'chip good' }, `to ${row.replayed_to}`) : 'no'));
    };
    const words = ['Letter', 'Route', 'Reason', 'Size', 'Replayed'];
    return h('table', { class: 'letters' },
      h('thead', {}, h('tr', {}, this.may ? h('th', { class: 'choose' }, every) : null, ...words.map((it) => h('th', { scope: 'col' }, it)))),
      h('tbody', {}, ...rows.map(line)));
  }

  async look(row) {
    let letter;
    const path = () => get(`api/dead-letters/${encodeURIComponent(this.topic)}/${row.partition}/${row.offset}`);
    try {
      letter = await path();
    } catch (error) {
      if (error.status !== 401) return toast(error.message, true);
      if (!await this.lock.unlock()) return undefined;
      letter = await this.lock.act(path);
      if (!letter) return undefined;
    }
    return this.showLetter(letter, row);
  }

  showLetter(letter, row) {
    const value = letter.value;
    const drawer = $('letter') ?? document.body.appendChild(h('dialog', { id: 'letter', class: 'drawer', 'aria-labelledby': 'letter-title' }));
    drawer.onclick = (event) => { if (event.target === drawer) drawer.close(); };
    const named = value.kind === 'left out' ? `Value: left out (${bytes(letter.bytes)})` : `Value: ${value.kind}, ${bytes(letter.bytes)}`;
    drawer.replaceChildren(
      h('div', { class: 'drawer-head' }, h('h2', { id: 'letter-title' }, letter.place),
        h('button', { type: 'button', class: 'close', 'aria-label': 'Close', onclick: () => drawer.close() }, '×')),
      h('p', { class: 'why' }, letter.reason),
      h('dl', { class: 'facts' }, ...facts([
        ['route', letter.route], ['source', letter.source], ['on its way to', letter.to],
        ['written', clock(letter.time_ms / 1000)], ['failed', letter.failed_ms ? clock(letter.failed_ms / 1000) : ''],
        ['replayed', row.replayed_to ? `to ${row.replayed_to}` : 'no'], ['key', letter.key ?? 'null'],
      ])),
      h('h3', {}, named), value.text ? h('pre', { tabindex: '0' }, value.text) : '',
      value.cut_bytes ? h('p', { class: 'note' }, `${bytes(value.cut_bytes)} more are not shown.`) : '',
      value.base64 ? h('button', { type: 'button', onclick: () => save(letter) }, 'Save the bytes') : '',
      letter.fields ? h('h3', {}, 'Fields of the message') : '', letter.fields ? h('pre', { tabindex: '0' }, letter.fields) : '',
      h('h3', {}, letter.headers.length ? 'Headers of the record' : 'No headers of its own'),
      h('dl', { class: 'facts' }, ...letter.headers.flatMap((it) => [h('dt', {}, it.name), h('dd', {}, it.value ?? 'null')])));
    drawer.showModal();
  }

  // A dry run first; what it said is shown with the button that does it.
  async begin(places) {
    const to = h('select', {}, h('option', { value: 'kafka' }, 'their Kafka topic, exactly once (Kafka 3.6.1 or later)'), h('option', { value: 'ros' }, 'ROS directly, at least once'));
    const again = h('input', { type: 'checkbox' });
    const force = h('input', { type: 'checkbox' });
    const what = places ? counted(places.length, 'letter') : 'All letters';
    const form = () => ({ topic: this.topic, places, to_ros: to.value === 'ros', again: again.checked, force: force.checked });
    const done = await this.lock.ask('Replay dead letters', [
      h('p', {}, `${what} of ${this.topic}. First a dry run says what would happen; nothing is sent by it.`),
      h('label', { class: 'field' }, 'Send to', to),
      h('label', { class: 'check' }, again, ' also what was replayed before'),
      h('label', { class: 'check' }, force, ' also what would fail again (Kafka only)'),
    ], 'Dry run', () => post('api/replay', { ...form(), dry_run: true }));
    if (done) this.pending = { number: done.number, form: form() };
  }

  drawJob(job) {
    show(this.job, Boolean(job));
    if (!job) return;
    drawn(this.job, [job, this.may, this.pending?.number], () => {
      const runs = job.status === null;
      const kind = job.dry_run ? 'Dry run' : 'Replay';
      const [word, tone] = outcome(job);
      const mine = job.dry_run && !runs && this.pending?.number === job.number;
      const send = mine && this.may && job.lines.some((line) => line.startsWith('would replay'));
      return [
        h('div', { class: 'head' }, h('h2', {}, `${kind} of ${job.topic}`),
          h('span', { class: `chip ${tone}` }, word),
          runs && this.may ? h('button', { type: 'button', onclick: () => this.lock.act(() => post('api/replay/stop')) }, 'Stop') : null,
          send ? h('button', { type: 'button', class: 'main', onclick: () => this.send() }, 'Replay them now') : null),
        h('pre', { tabindex: '0' }, job.lines.join('\n') || '…'),
      ];
    });
    if (job.status !== null && !job.dry_run && this.ended !== job.number) {
      this.ended = job.number;
      if (this.topic === job.topic) this.open(job.topic);
    }
  }

  async send() {
    const form = this.pending.form;
    this.pending = null;
    await this.lock.act(() => post('api/replay', { ...form, dry_run: false }));
  }
}

// How a replay went. Letters that stay are no failure of it; its lines say why they do.
function outcome(job) {
  if (job.status === null) return ['runs', 'busy'];
  if (job.status === 0) return ['done', 'good'];
  const last = job.lines.at(-1) ?? '';
  if (job.status < 0 || last.startsWith('stopped:')) return ['stopped', 'calm'];
  if (job.status === 1 && job.lines.some((line) => line.includes('left as they are'))) return job.dry_run ? ['some would stay', 'calm'] : ['some stay', 'warn'];
  return ['failed', 'bad'];
}

function save(letter) {
  const binary = atob(letter.value.base64);
  const url = URL.createObjectURL(new Blob([Uint8Array.from(binary, (char) => char.charCodeAt(0))]));
  h('a', { href: url, download: `${letter.place}.bin` }).click();
  setTimeout(() => URL.revokeObjectURL(url), 1000);
}
