// The server: the view as it changes, and requests.

const KEY = 'ros2-kafka-bridge-token';
const SILENT_MS = 6000;

export const token = () => sessionStorage.getItem(KEY);
export function keepToken(given) {
  if (given) sessionStorage.setItem(KEY, given);
  else sessionStorage.removeItem(KEY);
}

// Calls `onView` with the sections that changed, `onGone` while the server is away.
export function listen(onView, onOpen, onGone) {
  let source;
  let heard = performance.now();
  const open = () => {
    source = new EventSource('api/events');
    source.onopen = onOpen;
    source.onmessage = (event) => {
      heard = performance.now();
      onView(JSON.parse(event.data));
    };
    source.onerror = () => {
      onGone();
      // After an answer that is no stream, a browser does not try again by itself.
      if (source.readyState === EventSource.CLOSED) setTimeout(open, 2000);
    };
  };
  open();
  // A server that was stopped in mid-stream (a laptop that slept) shows by its silence only.
  setInterval(() => {
    if (performance.now() - heard < SILENT_MS || source.readyState === EventSource.CLOSED) return;
    heard = performance.now();
    onGone();
    source.close();
    open();
  }, 1000);
}

export class Refused extends Error {
  constructor(text, status) {
    super(text);
    this.status = status;
  }
}

// Throws a Refused whose message is for people.
async function ask(path, options) {
  let answer;
  try {
    answer = await fetch(path, options);
  } catch {
    throw new Refused('The server of this page does not answer.', 0);
  }
  const content = await answer.json().catch(() => ({}));
  if (!answer.ok) throw new Refused(content.error ?? `Refused with status ${answer.status}.`, answer.status);
  return content;
}

const right = (given = token()) => (given ? { Authorization: `Bearer ${given}` } : {});

export const get = (path) => ask(path, { headers: right() });

export const post = (path, body = {}, given = token()) => ask(path, {
  method: 'POST',
  headers: { 'Content-Type': 'application/json', ...right(given) },
  body: JSON.stringify(body),
});
