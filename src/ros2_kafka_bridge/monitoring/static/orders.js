// What is asked of the bridge: the token first, and a question before anything that matters.

import { $, h, show, toast } from './shared/dom.js';
import { keepToken, post, token } from './shared/server.js';

const box = $('box');

// Opens a dialog; resolves with what `buttons` gave, null when it was closed.
function dialog(title, content, buttons) {
  return new Promise((resolve) => {
    const actions = buttons.map(([word, kind, act]) => h('button', { type: act ? 'submit' : 'button', class: kind, value: word, onclick: act ? null : () => box.close('') }, word));
    const error = h('p', { class: 'error', role: 'alert' });
    const form = h('form', {
      method: 'dialog',
      onsubmit: async (event) => {
        event.preventDefault();
        const [, , act] = buttons.find(([word]) => word === event.submitter?.value) ?? buttons.at(-1);
        error.textContent = '';
        actions.forEach((it) => { it.disabled = true; });
        try {
          resolve(await act());
          box.close('done');
        } catch (problem) {
          error.textContent = problem.message;
        }
        actions.forEach((it) => { it.disabled = false; });
      },
    }, h('h2', { id: 'box-title' }, title), ...content, error, h('div', { class: 'actions' }, ...actions));
    box.replaceChildren(form);
    box.onclose = () => resolve(null);
    box.showModal();
  });
}

export class Lock {
  constructor(changed) {
    this.changed = changed;
    $('unlock').onclick = () => (token() ? this.lock() : this.unlock());
  }

  mayChange(bridge) {
    return Boolean(bridge?.may_change && token());
  }

  draw(bridge) {
    const can = Boolean(bridge?.may_change);
    const open = this.mayChange(bridge);
    show($('unlock'), can);
    $('unlock').textContent = open ? 'Lock' : 'Unlock…';
    show($('reload'), open);
    $('locked').textContent = open ? '' : can ? 'Read-only until you unlock it' : 'Read-only';
    $('locked').title = can ? '' : 'Set monitoring.token in the configuration to pause, resume, replay and reload from here.';
    show($('locked'), !open);
  }

  lock() {
    keepToken(null);
    this.changed();
  }

  async unlock() {
    const input = h('input', { type: 'password', required: true, autocomplete: 'off', name: 'token' });
    const done = await dialog('Unlock this page', [
      h('p', {}, 'Enter the token of the bridge: monitoring.token in its configuration. It is kept until this tab is closed.'),
      h('label', { class: 'field' }, 'Token', input),
    ], [['Cancel', '', null], ['Unlock', 'main', async () => {
      const given = input.value.trim();
      await post('api/token', {}, given);
      keepToken(given);
      return true;
    }]]);
    if (done) this.changed();
    return done;
  }

  // Does something that needs the token; says what came of it.
  async act(work) {
    try {
      const answer = await work();
      if (answer?.text) toast(answer.text);
      return answer;
    } catch (error) {
      if (error.status === 401) this.lock();
      toast(error.message, true);
      return null;
    }
  }

  async reload() {
    const preview = await this.act(async () => {
      const { changes, text } = await post('api/reload', { preview: true });
      return { changes, said: text };
    });
    if (!preview) return;
    const changes = preview.changes ?? [];
    if (!changes.length) {
      await dialog('Reload the configuration', [h('p', {}, 'The file says what already runs: nothing would change.')], [['Close', 'main', null]]);
      return;
    }
    const done = await dialog('Reload the configuration', [
      h('p', {}, 'This would change. Routes that are not named go on untouched.'),
      h('p', { class: 'note' }, preview.said),
      h('ul', { class: 'changes' }, ...changes.map((line) => h('li', { class: { '+': 'added', '-': 'removed' }[line[0]] ?? '' }, line))),
    ], [['Cancel', '', null], ['Reload', 'main', () => post('api/reload', { preview: false })]]);
    if (done) toast(done.text);
  }

  pause(route) {
    const word = route.paused ? 'resume' : 'pause';
    return this.act(() => post(`api/routes/${encodeURIComponent(route.name)}/${word}`));
  }

  ask(title, content, word, act) {
    return dialog(title, content, [['Cancel', '', null], [word, 'main', act]]);
  }
}
