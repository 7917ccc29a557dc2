// Small helpers for the document. Text is always set as text, never as HTML.

export const $ = (id) => document.getElementById(id);

export function h(tag, props = {}, ...children) {
  const node = document.createElement(tag);
  for (const [name, value] of Object.entries(props)) {
    if (name.startsWith('on')) node.addEventListener(name.slice(2), value);
    else if (name === 'class') node.className = value;
    else if (name in node && name !== 'list') node[name] = value;
    else node.setAttribute(name, value);
  }
  node.append(...children);
  return node;
}

export function setText(node, text) {
  const wanted = String(text);
  if (node.textContent !== wanted) node.textContent = wanted;
}

export function setAttr(node, name, value) {
  const wanted = String(value);
  if (node.getAttribute(name) !== wanted) node.setAttribute(name, wanted);
}

export function show(node, visible) {
  if (node.hidden === visible) node.hidden = !visible;
}

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
    if (node === undefined) {
      node = make(row);
      kept.set(name, node);
    }
    update(node, row);
    if (node === before) before = before.nextElementSibling;
    else parent.insertBefore(node, before);
  }
  for (const [name, node] of kept) {
    if (wanted.has(name)) continue;
    node.remove();
    kept.delete(name);
  }
}
