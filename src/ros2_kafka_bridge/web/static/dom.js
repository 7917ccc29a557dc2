// Small helpers for the document. Text is always set as text, never as HTML.

export const $ = (id) => document.getElementById(id);

export function h(tag, props = {}, ...children) {
  const node = document.createElement(tag);
  for (const [name, value] of Object.entries(props)) {
    if (value === undefined || value === null) continue;
    if (name.startsWith('on')) node.addEventListener(name.slice(2), value);
    else if (name === 'class') node.className = value;
    else if (name in node && name !== 'list') node[name] = value;
    else node.setAttribute(name, value);
  }
  node.append(...children.filter((child) => child !== null && child !== undefined));
  return node;
}

export function svg(tag, props = {}, ...children) {
  const node = document.createElementNS('http://www.w3.org/2000/svg', tag);
  for (const [name, value] of Object.entries(props)) node.setAttribute(name, value);
  node.append(...children);
  return node;
}

export function setText(node, text) {
  const wanted = String(text);
  if (node.textContent !== wanted) node.textContent = wanted;
}

export function setAttr(node, name, value) {
  if (value === null) node.removeAttribute(name);
  else if (node.getAttribute(name) !== String(value)) node.setAttribute(name, value);
}

export function show(node, visible) {
  if (node.hidden === visible) node.hidden = !visible;
}

export function setChip(node, word, tone) {
  setText(node, word);
  setAttr(node, 'class', `chip ${tone}`);
}

// What is known of something, for a list of words and values; empty values are left out.
export const facts = (pairs) => pairs.filter(([, value]) => (value ?? '') !== '')
  .flatMap(([word, value]) => [h('dt', {}, word), h('dd', {}, value)]);

// Keeps one element for each row, in the order of the rows; an element that stays keeps its focus.
// Elements before `first` are left alone.
export function keyed(parent, rows, key, make, update, first = parent.firstElementChild) {
  const kept = (parent.kept ??= new Map());
  const wanted = new Set();
  let before = first;
  for (const row of rows) {
    const name = key(row);
    wanted.add(name);
    let node = kept.get(name);
    if (node === undefined) kept.set(name, node = make(row));
    update?.(node, row);
    if (node === before) before = before.nextElementSibling;
    else parent.insertBefore(node, before);
  }
  for (const [name, node] of kept) {
    if (wanted.has(name)) continue;
    node.remove();
    kept.delete(name);
  }
}

// Draws anew only what is told differently from before.
export function drawn(parent, content, draw) {
  const told = JSON.stringify(content ?? null);
  if (parent.told === told) return;
  parent.told = told;
  parent.replaceChildren(...[draw(content)].flat().filter(Boolean));
}

let hiding;
export function toast(text, bad = false) {
  const node = $('toast');
  node.className = bad ? 'toast bad' : 'toast';
  node.textContent = text;
  // A modal dialog covers the page: what is said there stands in it.
  const open = document.querySelector('dialog[open]');
  (open ?? document.body).append(node);
  show(node, true);
  clearTimeout(hiding);
  hiding = setTimeout(() => show(node, false), bad ? 9000 : 4000);
}
